"""Files of the page, which shares its style and its viewer with the report."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from rsdeblur.report.page import part

HTML, CSS, SCRIPT = (f"text/{kind}; charset=utf-8" for kind in ("html", "css", "javascript"))


def page_files() -> dict[str, tuple[str, bytes]]:
    """Return the content type and the content of each file, by name; "" is the start page."""
    folder = files("rsdeblur.app")
    html, css, script = (folder.joinpath(f"app.{kind}").read_text("utf-8") for kind in ("html", "css", "js"))
    texts = {
        "": (HTML, Template(html).substitute(viewer=part("page_viewer.html"))),
        "style.css": (CSS, part("page.css") + css),
        "app.js": (SCRIPT, "\n".join([part("page_shared.js"), part("page_viewer.js"), script])),
    }
    return {name: (kind, text.encode()) for name, (kind, text) in texts.items()}
