"""The report's page in a real browser: divider, zoom, keyboard, touch, choice of pictures, and no error on the console.

Needs the package playwright (extra `browser-test`) and a Chromium: the one named by RSDEBLUR_CHROMIUM, or one on the
path.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from rsdeblur.report.page import write_page

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

# Colours of the report's pictures, display values times 255; JPEG may move them by a little.
RED, GREEN, BLUE = (153, 0, 0), (0, 153, 0), (0, 0, 153)
HOSTILE = """</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 2">"""


@pytest.fixture
def show(browser, report_page, tmp_path):
    """Open a report in a new window; at the end, there must be no error and no request other than for the page."""
    complaints: list[str] = []
    contexts = []

    def open_page(*, size: tuple[int, int] = (1000, 1100), direction: str = "top-down", **options) -> Tab:
        path = tmp_path / "report.html"
        write_page(path, report_page(photo=HOSTILE, remark=HOSTILE, direction=direction))
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        fetched = []
        tab.on("request", lambda request: fetched.append(request.url))
        tab.goto(path.as_uri())
        tab.wait_for_selector("#viewer:not([hidden])")
        assert {url for url in fetched if not url.startswith("data:")} == {path.as_uri()}
        return tab

    yield open_page
    for context in contexts:
        for tab in context.pages:
            assert tab.evaluate("window.hacked") is None
        context.close()
    assert complaints == []


def pixel(tab: Tab, x: float, y: float = 0.3) -> tuple[int, ...]:
    """Return the colour at these shares of the stage, once everything is drawn."""
    return tuple(
        tab.evaluate(
            """([x, y]) => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
                const canvas = document.getElementById("canvas");
                const place = [Math.floor(x * canvas.width), Math.floor(y * canvas.height)];
                done([...canvas.getContext("2d").getImageData(...place, 1, 1).data].slice(0, 3));
            })))""",
            [x, y],
        )
    )


def close_to(colour: tuple[int, ...]):
    return pytest.approx(colour, abs=6)


def centre(tab: Tab, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
    """Return the place on the screen at these shares of the stage."""
    tab.locator("#stage").scroll_into_view_if_needed()
    box = tab.locator("#stage").bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def pointed(tab: Tab, x: float, y: float) -> tuple[int, int]:
    """Return the picture's pixel under these shares of the stage, as the page shows it."""
    tab.mouse.move(*centre(tab, x, y))
    words = tab.inner_text("#pointer").replace(",", "").replace(":", "").split()
    return int(words[1]), int(words[3])


def test_divider_by_its_range_by_keyboard_and_by_hand(show) -> None:
    tab = show()
    assert pixel(tab, 0.45) == close_to(RED)
    assert pixel(tab, 0.55) == close_to(BLUE)
    tab.fill("#divider", "30")
    assert pixel(tab, 0.35) == close_to(BLUE)
    tab.focus("#divider")
    tab.keyboard.press("End")
    assert pixel(tab, 0.9) == close_to(RED)
    tab.focus("#stage")
    for _ in range(6):
        tab.keyboard.press(",")
    # Six steps of 2 % from the right.
    assert float(tab.input_value("#divider")) == pytest.approx(88)
    tab.mouse.move(*centre(tab, 0.6))
    tab.mouse.down()
    tab.mouse.move(*centre(tab, 0.25), steps=4)
    tab.mouse.up()
    assert float(tab.input_value("#divider")) == pytest.approx(25, abs=0.3)
    assert pixel(tab, 0.22) == close_to(RED)
    assert pixel(tab, 0.30) == close_to(BLUE)


def test_any_pair_of_pictures(show) -> None:
    tab = show()
    assert tab.locator("#left option").all_inner_texts() == ["input", "global", "banded"]
    tab.select_option("#left", "global")
    assert pixel(tab, 0.4) == close_to(GREEN)
    tab.click("#swap")
    assert (pixel(tab, 0.4), pixel(tab, 0.6)) == (close_to(BLUE), close_to(GREEN))
    tab.focus("#stage")
    tab.keyboard.press("x")
    # Names are drawn with the pictures.
    assert (pixel(tab, 0.4), pixel(tab, 0.6)) == (close_to(GREEN), close_to(BLUE))
    assert (tab.inner_text("#tag-left"), tab.inner_text("#tag-right")) == ("global", "banded")


def test_zoom_and_pan_move_both_pictures_alike(show) -> None:
    tab = show()
    whole = tab.inner_text("#zoom")
    assert pointed(tab, 0.5, 0.5) == (80, 60)
    before = pointed(tab, 0.25, 0.75)
    tab.mouse.dblclick(*centre(tab, 0.25, 0.75))
    # The place under the pointer stays; half the distances.
    assert pointed(tab, 0.25, 0.75) == pytest.approx(before, abs=1)
    assert pointed(tab, 0.5, 0.75)[0] - before[0] == pytest.approx((80 - before[0]) / 2, abs=1)
    tab.focus("#stage")
    tab.keyboard.press("ArrowRight")
    assert pointed(tab, 0.25, 0.75)[0] > before[0] + 2
    # The pictures follow the hand.
    held = pointed(tab, 0.7, 0.6)
    tab.mouse.down()
    tab.mouse.move(*centre(tab, 0.6, 0.5), steps=3)
    tab.mouse.up()
    assert pointed(tab, 0.6, 0.5) == pytest.approx(held, abs=1)

    tab.select_option("#layout", "side")
    assert pointed(tab, 0.1, 0.4) == pointed(tab, 0.6, 0.4)
    assert (pixel(tab, 0.2), pixel(tab, 0.8)) == (close_to(RED), close_to(BLUE))
    right, zoom = pointed(tab, 0.85, 0.4), tab.inner_text("#zoom")
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -200)
    tab.keyboard.up("Control")
    tab.wait_for_function("(before) => document.getElementById('zoom').value !== before", arg=zoom)
    assert pointed(tab, 0.85, 0.4) == pytest.approx(right, abs=1)
    assert pointed(tab, 0.1, 0.4) == pointed(tab, 0.6, 0.4)

    tab.focus("#stage")
    tab.keyboard.press("1")
    assert tab.inner_text("#zoom") == "100 %"
    tab.keyboard.press("+")
    assert tab.inner_text("#zoom") == "150 %"
    tab.select_option("#layout", "slider")
    tab.focus("#stage")
    tab.keyboard.press("0")
    assert tab.inner_text("#zoom") == whole


def test_fingers_pinch_and_drag(show) -> None:
    tab = show(size=(390, 844), has_touch=True, is_mobile=True, device_scale_factor=2)
    touch = tab.context.new_cdp_session(tab)

    def fingers(kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(centre(tab, *place) for place in places)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    fingers("touchStart", (0.8, 0.5))
    fingers("touchMove", (0.6, 0.5))
    fingers("touchMove", (0.3, 0.5))
    fingers("touchEnd")
    assert float(tab.input_value("#divider")) == pytest.approx(30, abs=1)
    whole = float(tab.inner_text("#zoom").split()[0])
    fingers("touchStart", (0.4, 0.5), (0.6, 0.5))
    fingers("touchMove", (0.35, 0.5), (0.65, 0.5))
    fingers("touchMove", (0.2, 0.5), (0.8, 0.5))
    fingers("touchEnd")
    assert float(tab.inner_text("#zoom").split()[0]) == pytest.approx(3 * whole, rel=0.05)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390


def test_psfs_lie_over_the_picture_at_their_places(show) -> None:
    tab = show()
    tab.fill("#divider", "100")
    tab.select_option("#bank", "global")
    # The one kernel is centred in the picture, a bar along x with a blue cross on it.
    glow = pixel(tab, 0.53, 0.5)
    assert glow[0] > 200 > pixel(tab, 0.53, 0.2)[0]
    assert "the PSF" in tab.inner_text("#bank-note")
    tab.check("#true-size")
    assert "true size" in tab.inner_text("#bank-note")
    # Of 160 px, the bar of 9 px covers 2.8 % to either side.
    assert pixel(tab, 0.52, 0.5)[0] > 200 > pixel(tab, 0.55, 0.5)[0]
    tab.focus("#stage")
    tab.keyboard.press("p")
    assert tab.input_value("#bank") == "banded"
    for x in (1 / 4, 3 / 4):
        for y in (1 / 6, 3 / 6, 5 / 6):
            assert pixel(tab, x + 0.02, y)[0] > 200
    tab.keyboard.press("p")
    assert tab.input_value("#bank") == ""
    assert pixel(tab, 0.52, 0.5) == close_to(RED)


@pytest.mark.parametrize("direction", ["top-down", "right-left"])
def test_a_line_shows_its_window_and_its_place(show, direction) -> None:
    tab = show(direction=direction)
    tab.fill("#divider", "100")
    tab.fill("#line", "40")
    # 40 of 120 rows are read before row 40; of 160 columns from the right, 119 before column 40.
    opens = 30 * (40 / 120 if direction == "top-down" else 119 / 160)
    assert f"exposed {opens:.2f} to {opens + 40:.2f} ms" in tab.inner_text("#line-note")
    assert tab.locator("#rates .chosen-line").count() == 1
    place = (0.3, 40.5 / 120) if direction == "top-down" else (40.5 / 160, 0.3)
    assert pixel(tab, *place) != close_to(RED)
    bottom = tab.locator("#rates .touchable")
    bottom.scroll_into_view_if_needed()
    box = bottom.bounding_box()
    tab.mouse.click(box["x"] + 50, box["y"] + box["height"] - 1)
    assert int(tab.input_value("#line")) > 0.95 * float(tab.get_attribute("#line", "max"))


def test_light_and_dark_and_narrow(show) -> None:
    grounds = []
    for scheme in ("light", "dark"):
        tab = show(size=(360, 640), color_scheme=scheme)
        grounds.append(tab.evaluate("getComputedStyle(document.body).backgroundColor"))
        assert tab.evaluate("document.documentElement.scrollWidth") <= 360
        assert tab.locator(".plot svg").count() == 1
    assert len(set(grounds)) == 2


def test_everything_is_reached_by_tab(show) -> None:
    tab = show()
    reached = []
    for _ in range(30):
        tab.keyboard.press("Tab")
        reached.append(tab.evaluate("document.activeElement.id || document.activeElement.tagName"))
    controls = ["left", "swap", "right", "layout", "bank", "true-size", "zoom-out", "zoom-in", "fit", "one", "stage"]
    for control in [*controls, "divider", "line"]:
        assert control in reached


def test_without_scripts_the_pictures_and_tables_are_there(show, browser, report_page, tmp_path) -> None:
    write_page(tmp_path / "plain.html", report_page())
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto((tmp_path / "plain.html").as_uri())
    assert tab.locator("#sources img").nth(1).is_visible()
    assert tab.locator("table").last.is_visible()
    assert not tab.locator("#viewer").is_visible()
    context.close()
