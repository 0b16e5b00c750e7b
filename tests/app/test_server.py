"""Laws of the local server: who may ask, what for, and how much."""

import http.client
import json
import re
import threading

import pytest

from rsdeblur.app import LocalServer, app_page
from rsdeblur.errors import InputError


def refuse(form):
    raise InputError("photo.jpg: <b>no</b> such file")


@pytest.fixture(scope="module")
def server():
    actions = {
        "echo": lambda form: {"form": form},
        "refuse": refuse,
        "malformed": lambda form: form["box"],
        "broken": lambda form: {"value": 1 / 0},
    }
    with LocalServer(app_page(), actions, lambda name, content: {"name": name, "size": len(content)}) as running:
        # Polled often, so that the end of the test does not wait.
        thread = threading.Thread(target=running.serve_forever, args=(0.01,))
        thread.start()
        yield running
        running.shutdown()
        thread.join()


@pytest.fixture
def ask(server):
    """Send a request and return status, headers and content; `path` follows the token."""

    def send(path, method="GET", body=None, *, token=None, headers=()):
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
        known = {"Host": f"127.0.0.1:{server.server_port}", "Content-Type": "application/json"} | dict(headers)
        connection.putrequest(method, f"/{token or server.token}/{path}", skip_host=True)
        if body is not None:
            known = {"Content-Length": str(len(body))} | known
        for name, value in known.items():
            connection.putheader(name, value)
        connection.endheaders(body)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer.status, answer.headers, content

    return send


def test_it_listens_on_the_loopback_address_only_and_every_start_has_a_new_token(server):
    assert server.server_address[0] == "127.0.0.1"
    with LocalServer("", {}, refuse) as other:
        assert len(other.token) >= 32
        assert other.token != server.token


def test_the_page_comes_with_a_policy_that_allows_nothing_from_outside(ask):
    status, headers, content = ask("")
    assert (status, len(content)) == (200, int(headers["Content-Length"]))
    (own,) = re.findall(r'http-equiv="Content-Security-Policy" content="(.*)"', content.decode())
    assert "default-src 'none'" in own
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert not re.search(r"http|\*|unsafe", own)
    assert headers["Referrer-Policy"] == "no-referrer"  # the address contains the token
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize("token", ["x", "%00", "..", "%C3%A9"])
def test_without_the_token_nothing_is_answered(ask, token):
    for method, body in (("GET", None), ("POST", b"{}")):
        status, _, content = ask("echo" if body else "", method, body, token=token)
        assert status == 403
        assert b"rsdeblur app printed" in content


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", ""])
@pytest.mark.parametrize("origin", ["http://evil.example", "null", None])
def test_other_hosts_and_pages_are_refused_even_with_the_token(ask, server, host, origin):
    known = {"Host": f"127.0.0.1:{server.server_port}"} if origin else {"Host": host}
    headers = known | ({"Origin": origin} if origin else {})
    assert ask("", headers=headers)[0] == 403
    assert ask("echo", "POST", b"{}", headers=headers)[0] == 403


def test_no_path_leads_to_a_file_and_no_method_to_more(ask):
    for path in ("../../../../etc/passwd", "..%2f..%2fetc/passwd", "/etc/passwd", "style.css/", "echo", "upload"):
        assert ask(path)[0] == 404
    assert ask("", "POST", b"{}")[0] == 404
    for method in ("HEAD", "PUT", "DELETE", "OPTIONS", "TRACE"):
        status, headers, _ = ask("", method)
        assert status == 501
        assert "Access-Control-Allow-Methods" not in headers


def test_bodies_are_bounded(ask):
    assert ask("echo", "POST", b'{"a": 1}')[2] == b'{"form": {"a": 1}}'
    assert ask("echo", "POST")[0] == 411
    for length, status in (
        ("-1", 411),
        ("\N{SUPERSCRIPT TWO}".encode("latin-1").decode("latin-1"), 411),
        ("65537", 413),
        ("9" * 5000, 413),
    ):
        assert ask("echo", "POST", b"", headers={"Content-Length": length})[0] == status
    octets = {"Content-Type": "application/octet-stream"}
    assert ask("upload", "POST", b"", headers=octets | {"Content-Length": str(2**40)})[0] == 413
    # The types that a form of another page can have.
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert ask("echo", "POST", b"{}", headers={"Content-Type": kind})[0] == 415
    assert ask("malformed", "POST", b"{}")[0] == 500
    for body in (b"", b"{", b"\xff", b"[" * 60000):
        assert ask("echo", "POST", body)[0] == 500
    _, _, content = ask("upload?name=a%2Fb.jpg", "POST", b"123", headers=octets)
    assert json.loads(content) == {"name": "a/b.jpg", "size": 3}


def test_a_browser_that_does_not_wait_for_the_answer_prints_nothing(server, capsys):
    """A page that is closed or loaded again drops its request."""
    for error in (BrokenPipeError(), ConnectionResetError(), OSError("disk")):
        try:
            raise error
        except OSError:
            server.handle_error(None, ("127.0.0.1", 1))
    (line,) = capsys.readouterr().err.splitlines()
    assert "disk" in line


def test_every_error_is_an_answer(ask, capsys):
    status, headers, content = ask("refuse", "POST", b"{}")
    assert (status, headers["Content-Type"]) == (422, "application/json")
    assert json.loads(content) == {"error": "photo.jpg: <b>no</b> such file"}
    status, _, content = ask("broken", "POST", b"{}")
    assert status == 500
    assert "ZeroDivisionError" in json.loads(content)["error"]
    assert capsys.readouterr().err == ""
