"""The local page: its forms, its saved pictures, and the page itself in a browser."""

from __future__ import annotations

import shlex
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import Exposure, Options, read_camera, read_gyro, read_picture
from rsdeblur.app import Crop, Desk, LocalServer, app_page, derive_basis, solve_crop
from rsdeblur.cli.app import engine
from rsdeblur.errors import InputError, OutputError, RsdeblurError


@pytest.fixture
def form(files):
    """The form for the photo of the fixture `files`, as the page sends it."""
    return {
        "photo": str(files.photo),
        "gyro": str(files.gyro),
        "camera": str(files.camera),
        "start": "0.2",
        "duration": "1/25",
        "mode": "global",
        "prior": "wiener",
        "output": str(files.photo.with_name("saved.png")),
        "box": [0, 0, 96, 72],
    }


@pytest.fixture
def make_desk(tmp_path):
    """Return a desk with its settings in a temporary folder, for photos and options of the command line."""
    return partial(Desk, engine(), settings=tmp_path / "settings")


@pytest.fixture
def desk(make_desk):
    with make_desk([], {}) as open_desk:
        yield open_desk


def test_the_saved_picture_is_that_of_the_copied_command(desk, form, run):
    moved = {"time_offset": "-2.5ms", "readout_time": "21ms", "focal_length": "104.5", "softness": "0.5"}
    form |= {"power": 0.5, "moved": moved, "more": "--threads 1"}
    command = shlex.split(desk.actions["solve"](form)["command"])
    assert command[:2] == ["rsdeblur", "deblur"]
    assert desk.actions["save"](form)["output"] == form["output"]
    output = Path(command[-1])
    by_app = output.read_bytes()
    output.unlink()
    assert run(*command[1:]).exit_code == 0
    assert output.read_bytes() == by_app


def test_a_crop_is_that_part_of_the_whole_result(files):
    """The margin around the crop keeps its border out; inside, only the tails of the filter differ."""
    pixels, options = read_picture(files.photo).pixels, Options(mode="global", prior="wiener", saturation="ignore")
    capture = read_gyro(files.gyro), read_camera(files.camera), Exposure(0.2, 1 / 25)
    basis = derive_basis(pixels, *capture, options)
    whole = solve_crop(pixels, *capture, options, basis, Crop(0, 0, 96, 72)).image
    crop = Crop(20, 16, 56, 40)
    part = solve_crop(pixels, *capture, options, basis, crop)
    assert part.image.shape == (40, 56, 3)
    # Of a noise picture, whose values spread by 0.16; one step of 8 bits is 0.004.
    assert np.abs(part.image - crop.cut(whole)).mean() < 0.02
    assert solve_crop(pixels, *capture, options, basis, crop, scale=0.5).image.shape == (20, 28, 3)


def test_nothing_is_overwritten_and_a_dropped_file_lands_in_the_folder_of_the_app(desk, form):
    output = Path(form["output"])
    output.write_bytes(b"mine")
    with pytest.raises(OutputError, match="the file exists; choose another name"):
        desk.actions["save"](form)
    with pytest.raises(InputError, match="choose the name of the result"):
        desk.actions["save"](form | {"output": ""})
    assert output.read_bytes() == b"mine"
    path = Path(desk.upload("../../etc/ph<oto>.png", b"content")["path"])
    assert path.name == "photo.png"
    assert path.read_bytes() == b"content"
    assert path.parent.stat().st_mode & 0o077 == 0
    for name in ("", "..", "/", "a/", "x" * 300):
        with pytest.raises(InputError, match="usable name"):
            desk.upload(name, b"")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": ""}, "choose the gyro log"),
        ({"gyro": "/nowhere/gyro.csv"}, "/nowhere/gyro.csv"),
        ({"start": "soon"}, "'soon' is not a time"),
        ({"more": "--nonsense"}, "No such option"),
        ({"more": "'"}, "other options: No closing quotation"),
    ],
)
def test_errors_have_the_text_of_the_command_line(desk, form, changes, message):
    with pytest.raises(RsdeblurError, match=message):
        desk.actions["solve"](form | changes)


def test_the_page_in_a_browser(browser, make_desk, files, form, tmp_path):
    """Open, move a slider, save: no error on the console, no request to the outside, no complaint of axe."""
    given = {name: form[name] for name in ("gyro", "camera", "start", "duration")}
    complaints: list[str] = []
    requests: list[str] = []
    with make_desk([form["photo"]], given) as desk, LocalServer(app_page(), desk.actions, desk.upload) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        context = browser.new_context(viewport={"width": 390, "height": 844}, color_scheme="dark")
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(server.url)
        tab.wait_for_selector("#verdict:not(:empty)")
        assert tab.inner_text("h1") == "photo.png"
        assert tab.is_visible("#viewer")
        assert tab.locator("#left option").all_inner_texts() == ["input", "result"]
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        assert "--time-offset" not in tab.input_value("#line")
        tab.focus("#time_offset")
        tab.keyboard.press("ArrowRight")
        for _ in range(100):
            if "--time-offset 0.50ms" in tab.input_value("#line"):
                break
            tab.wait_for_timeout(50)
        assert tab.inner_text("#time_offset-value") == "0.5 ms"
        tab.click("#save")
        tab.wait_for_selector("#saved:not([hidden])")
        assert tab.is_visible("#canvas")
        with Image.open(files.photo.with_name("photo-sharp.png")) as picture:
            assert picture.size == (96, 72)
        tab.click("summary")
        tab.fill("#gyro", str(tmp_path / "absent.csv"))
        tab.click("text=Open")
        tab.wait_for_selector("#error:not([hidden])")
        assert "absent.csv" in tab.inner_text("#error")
        assert violations(tab) == []
        assert [url for url in requests if not url.startswith(("data:", server.url))] == []
        context.close()
        server.shutdown()
    # The refusal of the absent file is an answer with status 422, which browsers list.
    assert [text for text in complaints if "422" not in text] == []


def violations(tab):
    """Return what axe finds in the page."""
    import axe_playwright_python

    script = (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text()
    # Through the debugger, because the page's policy forbids scripts from elsewhere.
    run = "axe.run().then((found) => found.violations.map((v) => [v.id, v.nodes.map((node) => node.html)]))"
    answer = tab.context.new_cdp_session(tab).send(
        "Runtime.evaluate", {"expression": f"{script};{run}", "awaitPromise": True, "returnByValue": True}
    )
    return answer["result"]["value"]
