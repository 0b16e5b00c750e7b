"""The built site, in a browser: what its search finds, and that it fits a phone. Needs `make docs`."""

from __future__ import annotations

from pathlib import Path

import pytest

SITE = Path(__file__).resolve().parents[1] / "site"
if not (SITE / "searchindex.js").is_file():
    pytest.skip("there is no site: make docs", allow_module_level=True)


@pytest.mark.parametrize(
    ("query", "page"),
    [
        ("readout time", "readout-times.html"),
        ("sensor logger", "tutorials/stock-camera.html"),
        ("json schema", "generated/commands/json.html"),
        ("burst", "tutorials/burst.html"),
        ("calibrate", "tutorials/calibrate.html"),
        ("camera file", "camera-file.html"),
    ],
)
def test_the_search_finds_the_page_first(browser, query: str, page: str) -> None:
    tab = browser.new_page()
    tab.goto(f"{SITE.as_uri()}/search.html?q={query.replace(' ', '+')}")
    found = tab.wait_for_selector("#search-results li > a").get_attribute("href")
    tab.close()
    assert found.partition("#")[0] == page


@pytest.mark.parametrize("page", ["index", "tutorials/first-photo", "tutorials/logger-apps", "generated/gallery/index"])
def test_pages_fit_a_phone(browser, page: str) -> None:
    tab = browser.new_page(viewport={"width": 400, "height": 800})
    tab.goto(f"{SITE.as_uri()}/{page}.html")
    assert tab.evaluate("document.documentElement.scrollWidth") <= 400
    # Tables scroll in a box of their own, and no option is broken over two lines.
    for kind, rule in (
        ("table", "el.closest('.pst-scrollable-table-container')"),
        ("pre .na", "el.getClientRects().length == 1"),
    ):
        assert tab.evaluate(f"[...document.querySelectorAll('.bd-article {kind}')].every((el) => {rule})")
    tab.close()
