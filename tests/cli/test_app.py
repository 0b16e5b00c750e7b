"""The local page: its forms, its saved pictures, and the page itself in a browser."""

import json
import shlex
import signal
import sys
import tempfile
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import Exposure, Options, read_camera, read_gyro, read_picture
from rsdeblur.app import Crop, LocalServer, app_page, derive_basis, solve_crop
from rsdeblur.cli._desk import Desk
from rsdeblur.cli._options import MANY
from rsdeblur.errors import InputError, OutputError, RsdeblurError
from tests.cli.conftest import found_offset


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
    return partial(Desk, settings=tmp_path / "settings")


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


def test_nothing_is_overwritten(desk, form):
    output = Path(form["output"])
    output.write_bytes(b"mine")
    with pytest.raises(OutputError, match="the file exists; choose another name"):
        desk.actions["save"](form)
    with pytest.raises(InputError, match="choose the name of the result"):
        desk.actions["save"](form | {"output": ""})
    assert output.read_bytes() == b"mine"


def test_files_that_the_browser_sent_have_the_names_that_the_user_knows(desk, form, tmp_path, monkeypatch):
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    sent = {n: desk.upload(Path(form[n]).name, Path(form[n]).read_bytes())["path"] for n in ("photo", "gyro", "camera")}
    form = form | sent | {"output": "", "readout_time": "0"}
    opened = desk.actions["open"](form)
    assert opened["output"] == str(folder / "photo-sharp.png")
    # Without a folder, the copied command can be run in that of the files.
    words = shlex.split(desk.actions["solve"](form)["command"])
    assert [words[2], words[4], words[6]] == ["photo.png", "gyro.csv", "camera.toml"]
    with pytest.raises(RsdeblurError) as caught:
        desk.actions["solve"](form | {"start": "99"})
    assert str(caught.value).startswith("gyro.csv: ")
    assert tempfile.gettempdir() not in "".join([str(caught.value), *opened["notes"]])


def test_every_option_of_the_recording_has_a_field(make_desk):
    with make_desk([], dict.fromkeys(MANY, "1")) as desk:
        form = desk.actions["start"]({})["form"]
    assert form.keys() >= {"gyro", "start", "time_offset"}
    assert [name for name in form if f' name="{name}"' not in app_page()] == []
    others = shlex.split(form["more"])
    assert sorted(others[::2]) == sorted(f"--{name.replace('_', '-')}" for name in MANY if name not in form)


def test_the_last_camera_file_is_offered_again(make_desk, form):
    camera = Path(form["camera"])
    for name in ("first.toml", "phone.toml"):
        camera = camera.rename(camera.with_name(name))
        with make_desk([], {}) as desk:
            desk.actions["open"](form | {"camera": str(camera)})
    with make_desk([], {}) as desk:
        kept = desk.actions["start"]({})["camera"]
        assert Path(kept).name == "phone.toml"
        assert Path(kept).read_bytes() == camera.read_bytes()
        assert desk.actions["open"](form | {"camera": kept})["size"] == [96, 72]


def test_the_example_opens_and_its_camera_is_nobodys(desk, tmp_path):
    opened = desk.actions["open"](desk.actions["example"]({})["form"])
    assert (opened["name"], opened["axes"], opened["start"]) == ("blurred.png", None, 0.25)
    assert not (tmp_path / "settings").exists()


def test_a_photo_and_its_log_suffice(desk, files, form, run, monkeypatch, tmp_path):
    """Camera and moment are those of EXIF; the search for the moment, which has its own tests, is not repeated."""
    noon_ns, late = 1_766_385_749_000_000_000, 0.5
    rows = [f"{noon_ns + round(1e9 * t)},{x},{y},{z}" for t, x, y, z in files.samples()]
    files.gyro.write_text("\n".join(["time,x,y,z", *rows]) + "\n")
    exif = Image.Exif()
    times = {0x9003: "2025:12:22 08:42:29", 0x9291: f"{round(1e3 * (0.2 + late))}", 0x829A: 1 / 25, 0xA405: 40}
    exif.get_ifd(0x8769).update(times)
    photo = tmp_path / "IMG_1.jpg"
    Image.open(files.photo).save(photo, exif=exif, quality=98)
    searches = []

    def search(*recording, **options):
        searches.append(1)
        return found_offset(late)(*recording, **options)

    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", search)
    form = form | {"photo": str(photo), "camera": "", "start": "", "duration": "", "output": str(tmp_path / "a.jpg")}
    opened = desk.actions["open"](form)
    assert opened["start"] == pytest.approx(0.2, abs=1e-6)  # of nanoseconds that a float counts from 1970
    assert (opened["duration"], opened["readout_is_guess"]) == (1 / 25, True)
    form |= opened["moment"]
    command = shlex.split(desk.actions["solve"](form)["command"])
    assert "--camera" not in command
    desk.actions["save"](form)
    assert run(*command[1:-1], tmp_path / "b.jpg").exit_code == 0
    assert (tmp_path / "a.jpg").read_bytes() == (tmp_path / "b.jpg").read_bytes()
    assert searches == [1]


def test_a_browser_in_the_foreground_is_served_and_its_arguments_contain_no_token(tmp_path, processes, monkeypatch):
    temporary, facts = tmp_path / "tmp", tmp_path / "facts.json"
    temporary.mkdir()
    browser = tmp_path / "browser.py"
    browser.write_text(
        "import json, os, re, sys, urllib.request\n"
        "place = urllib.request.url2pathname(sys.argv[1].removeprefix('file://'))\n"
        "url = re.search('url=([^\"]+)', open(place).read())[1]\n"
        "with urllib.request.urlopen(url, timeout=60) as answer:\n"
        "    seen = sys.argv[1:], url, os.stat(os.path.dirname(place)).st_mode & 0o777, answer.status\n"
        f"open({str(facts) + '.part'!r}, 'w').write(json.dumps(seen))\n"
        f"os.rename({str(facts) + '.part'!r}, {str(facts)!r})\n"
    )
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setenv("BROWSER", f"{sys.executable} {browser} %s")
    with processes.started("app") as app:
        processes.until(app, facts.exists)
        arguments, url, mode, status = json.loads(facts.read_text())
        app.send_signal(signal.SIGINT)
        out, err = app.communicate(timeout=60)
    assert (app.returncode, err) == (0, "")
    assert out.splitlines()[0] == url
    assert (mode, status) == (0o700, 200)
    assert url.split("/")[3] not in " ".join(arguments)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": ""}, "choose the gyro log"),
        ({"gyro": "/nowhere/gyro.csv"}, "/nowhere/gyro.csv"),
        ({"start": "soon"}, "'soon' is not a time"),
        ({"more": "--nonsense"}, "No such option"),
        ({"more": "'"}, "other options: No closing quotation"),
        ({"photo": "~nobody-here/x.png"}, "~nobody-here/x.png"),
    ],
)
def test_errors_have_the_text_of_the_command_line(desk, form, changes, message):
    with pytest.raises(RsdeblurError, match=message):
        desk.actions["solve"](form | changes)


def test_the_page_in_a_browser(browser, make_desk, files, form, tmp_path):
    """Choose files, move a slider, save: no error on the console, no request to the outside, no complaint of axe."""
    complaints: list[str] = []
    requests: list[str] = []
    given = {name: form[name] for name in ("start", "duration")}
    with make_desk([], given) as desk, LocalServer(app_page(), desk.actions, desk.upload) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        context = browser.new_context(viewport={"width": 400, "height": 844}, color_scheme="dark")
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("request", lambda request: requests.append(request.url))
        tab.goto(server.url)
        tab.wait_for_selector("#example")
        assert violations(tab) == []
        tab.set_input_files("#picker", [files.camera, files.photo])
        tab.wait_for_selector("#busy:has-text('gyro log')")
        assert tab.inner_text("#chosen").split() == ["Photo", "photo.png", "Camera", "camera.toml"]
        tab.set_input_files("#picker", files.gyro)
        tab.wait_for_selector("#verdict:not(:empty)")
        assert tab.inner_text("h1") == "photo.png"
        assert tab.is_visible("#viewer")
        assert tab.locator("#left option").all_inner_texts() == ["before", "after"]
        assert tab.evaluate("document.documentElement.scrollWidth") <= 400
        assert "--time-offset" not in tab.input_value("#line")
        tab.focus("#time_offset")
        tab.keyboard.press("ArrowRight")
        command_has(tab, "--time-offset 0.50ms")
        assert tab.inner_text("#time_offset-value") == "0.5 ms"
        tab.fill("#output", str(tmp_path / "saved.png"))
        tab.focus("#save")
        tab.keyboard.press("Enter")
        tab.wait_for_selector("#saved:not([hidden])")
        with Image.open(tmp_path / "saved.png") as picture:
            assert picture.size == (96, 72)
        # A chip opens the field of its value.
        tab.focus("#chips button:has-text('Readout')")
        tab.keyboard.press("Enter")
        tab.keyboard.type("10ms")
        tab.keyboard.press("Enter")
        tab.wait_for_selector("#chips button:has-text('10.0 ms')")
        command_has(tab, "--readout-time 10ms")
        tab.click("summary")
        tab.fill("#gyro", str(tmp_path / "absent.csv"))
        tab.keyboard.press("Enter")
        tab.wait_for_selector("#error:not([hidden])")
        assert "absent.csv" in tab.inner_text("#error")
        assert violations(tab) == []
        tab.reload()
        tab.wait_for_selector("#last-camera:has-text('camera.toml')")
        assert [url for url in requests if not url.startswith(("data:", server.url))] == []
        context.close()
        server.shutdown()
    # The refusal of the absent file is an answer with status 422, which browsers list.
    assert [text for text in complaints if "422" not in text] == []


def command_has(tab, words):
    """Wait until the copied command contains these words."""
    tab.wait_for_selector("#viewer")
    for _ in range(600):
        if words in tab.input_value("#line"):
            return
        tab.wait_for_timeout(50)
    raise AssertionError(tab.input_value("#line"))


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
