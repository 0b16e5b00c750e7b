"""The server of the local page, and the files that the browser sends.

It has a token in every address, the loopback interface only, and no access to files.

The token keeps other users and programs out. The check of the Host header keeps out pages of the web whose name was
made to resolve to this machine (DNS rebinding); the check of the Origin header and of the content type keeps out their
requests. Paths are names of actions, never names of files.
"""

import hmac
import json
import re
import secrets
import socketserver
import sys
import threading
import webbrowser
from collections.abc import Callable, Mapping
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory, gettempdir, mkdtemp
from typing import Any
from urllib.parse import parse_qs

from rsdeblur.errors import InputError, OutputError, RsdeblurError
from rsdeblur.pipeline.options import Options
from rsdeblur.report.page import document, part

LOOPBACK = "127.0.0.1"
# Content type and most bytes of a request's body: a form, and a photo or log.
FORM, FILE = ("application/json", 64 << 10), ("application/octet-stream", 512 << 20)
HEADERS = {
    # The page itself forbids scripts, styles and sources that are not its own.
    "Content-Security-Policy": "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
# Of the names of temporary folders.
PREFIX = "rsdeblur-app-"

Action = Callable[[Mapping[str, Any]], Mapping[str, Any]]
Upload = Callable[[str, bytes], Mapping[str, Any]]


def app_page() -> str:
    """Return the page, which shares its style and its viewer with the report."""
    own = files("rsdeblur.app")
    default_prior = Options().prior_in_effect
    html, css, script = (own.joinpath(f"app.{kind}").read_text("utf-8") for kind in ("html", "css", "js"))
    return document(
        kind="rsdeblur app",
        title="Deblur a photo",
        facts="Nothing leaves this machine",
        main=Template(html).substitute(
            viewer=part("page_viewer.html"), modes=_choices("mode", "auto"), priors=_choices("prior", default_prior)
        ),
        style=css,
        script=part("page_viewer.js") + script,
        allowed="; connect-src 'self'",
    )


def _choices(name: str, chosen: object) -> str:
    """Return the values of an option as the choices of a form."""
    values = Options.__dataclass_fields__[name].metadata["choices"]
    return "".join(f"<option{' selected' if value == chosen else ''}>{value}</option>" for value in values)


class LocalServer(socketserver.ThreadingTCPServer):
    """Server of a page of HTML and its actions for the browser on this machine; port 0 is a free one.

    POST calls the action of its name with the form in its JSON body, and sends the answer as JSON, or the text of an
    error of rsdeblur. `upload` receives the name and the content of a file that the browser sends.
    """

    daemon_threads = allow_reuse_address = True

    def __init__(self, page: str, actions: Mapping[str, Action], upload: Upload, port: int = 0) -> None:
        self.page, self.actions, self.upload = page, actions, upload
        self.token = secrets.token_urlsafe(24)
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except OSError as error:
            raise InputError(f"port {port}: {error.strerror}; leave it out to take a free one") from error
        self.server_port = self.server_address[1]
        self.hosts = {f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost")}

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Report an error in one line, but not that a browser has closed its connection before the answer."""
        error = sys.exc_info()[1]
        if not isinstance(error, ConnectionError):
            print(f"rsdeblur: a request failed: {type(error).__name__}: {str(error)!a}", file=sys.stderr)

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"


class _Refusal(Exception):
    """A request that is refused, with its status and reason as arguments."""


class _Handler(BaseHTTPRequestHandler):
    server: LocalServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "rsdeblur", ""
    # Seconds without a byte after which a connection is closed.
    timeout = 30

    def do_GET(self) -> None:
        """Send the page; run an action, or receive a file, which are for POST."""
        try:
            name, query = self._name()
            if self.command == "GET" and not name:
                self._send(HTTPStatus.OK, "text/html; charset=utf-8", self.server.page.encode())
            elif self.command == "POST" and (name == "upload" or name in self.server.actions):
                body = self._body(*(FILE if name == "upload" else FORM))
                status, answer = self._answer(name, query, body)
                self._send(status, FORM[0], json.dumps(answer).encode())
            else:
                raise _Refusal(HTTPStatus.NOT_FOUND, "no such page or action")
        except _Refusal as refusal:
            self.send_error(*refusal.args)

    do_POST = do_GET

    def _name(self) -> tuple[str, str]:
        """Return the name after the token and the query, of a request that may come from our page."""
        if self.headers.get("Host") not in self.server.hosts:
            raise _Refusal(HTTPStatus.FORBIDDEN, "unknown host")
        origin = self.headers.get("Origin")
        if origin is not None and origin.removeprefix("http://") not in self.server.hosts:
            raise _Refusal(HTTPStatus.FORBIDDEN, "request of another page")
        path, _, query = self.path.partition("?")
        token, _, name = path.removeprefix("/").partition("/")
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.server.token.encode()):
            raise _Refusal(HTTPStatus.FORBIDDEN, "wrong token: open the address that rsdeblur app printed")
        return name, query

    def _body(self, kind: str, most: int) -> bytes:
        # A page of another origin could send a form, but neither of these types without asking first.
        if self.headers.get_content_type() != kind:
            raise _Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"the body must be {kind}")
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal():
            raise _Refusal(HTTPStatus.LENGTH_REQUIRED, "the request must give the length of its body")
        if len(length) > len(str(most)) or int(length) > most:
            raise _Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"the body has more than {most} bytes")
        return self.rfile.read(int(length))

    def _answer(self, name: str, query: str, body: bytes) -> tuple[HTTPStatus, Mapping[str, Any]]:
        try:
            if name == "upload":
                return HTTPStatus.OK, self.server.upload(parse_qs(query).get("name", [""])[0], body)
            return HTTPStatus.OK, self.server.actions[name](json.loads(body))
        except RsdeblurError as error:
            return HTTPStatus.UNPROCESSABLE_ENTITY, {"error": str(error)}
        except Exception as error:
            # Whatever it is, the page shows it.
            text = f"the app failed ({type(error).__name__}: {error}); try again, or use rsdeblur deblur"
            return HTTPStatus.INTERNAL_SERVER_ERROR, {"error": text}

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Send an error as plain text, and close the connection: the body may not have been read."""
        self.close_connection = True
        text = message or HTTPStatus(code).phrase
        self._send(HTTPStatus(code), "text/plain; charset=utf-8", f"{text}\n".encode("utf-8", "replace"))

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(len(content)), **HEADERS}
        for name, value in headers.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: addresses contain the token."""


class Uploads(TemporaryDirectory[str]):
    """Files that the browser sent, for this user only: each in its own folder, as others may have the same name."""

    def __init__(self) -> None:
        super().__init__(prefix=PREFIX, ignore_cleanup_errors=True)

    def new_folder(self) -> Path:
        """Make a folder, which is removed at the end."""
        return Path(mkdtemp(dir=self.name))

    def keep(self, name: str, content: bytes) -> Path:
        """Write a file, and return its path, which has the last part of `name`."""
        # Without anything that a system treats specially.
        clean = "".join(c for c in name.replace("\\", "/").rpartition("/")[2] if c.isprintable() and c not in '<>:"|?*')
        if not clean.strip(". "):
            raise InputError("the file has no usable name; rename it")
        try:
            path = self.new_folder() / clean
            path.write_bytes(content)
        except OSError as error:
            raise OutputError(
                f"{clean}: cannot write to the temporary folder {gettempdir()}: {error.strerror}; free space there, or "
                "set TMPDIR to another folder, and start the app again"
            ) from error
        return path

    def has(self, path: Path) -> bool:
        """Return whether a path leads to one of the files."""
        return path.is_relative_to(self.name)

    def browse(self, address: str) -> None:
        """Open `address`, which has the token, through a private file: every user sees a browser's arguments."""
        path, url = Path(self.name) / "open.html", escape(address)
        page = f'<meta http-equiv="refresh" content="0; url={url}"><a href="{url}">rsdeblur app</a>\n'
        path.write_text(f'<!doctype html><meta charset="utf-8"><title>rsdeblur app</title>{page}')
        # Some browsers return only when they are closed.
        threading.Thread(target=webbrowser.open, args=(path.as_uri(),), daemon=True).start()


def plain(text: str) -> str:
    """Return a text in which files that the browser sent have the names that the user knows."""
    return re.sub(rf"{re.escape(str(Path(gettempdir()) / PREFIX))}[^/\\]+[/\\][^/\\]+[/\\]", "", text)
