"""Each command does its work on small files."""

from __future__ import annotations

import json
import re
import shlex
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur import RsdeblurWarning, deconvolve
from rsdeblur.estimate.time_offset import OffsetSearch
from rsdeblur.io import read_camera, read_picture
from rsdeblur.io.pictures import read_psfs
from rsdeblur.psf import PsfBank
from tests.cli.conftest import found_offset

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]

WIDTH, HEIGHT = 96, 72
START, DURATION = 0.2, 0.04


def bits(path: Path) -> bytes:
    """Return the samples of a picture, whose metadata name the options."""
    return read_picture(path).pixels.tobytes()


def test_deblur_writes_the_picture_and_one_line(run: Run, files: Files, tmp_path: Path) -> None:
    out = tmp_path / "sharp.png"
    result = run("deblur", files.photo, *files.recording, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    # No reasons, or one line with reasons.
    assert all(line.startswith("  ") for line in result.stdout.splitlines()[1:])
    assert "banded" in result.stdout
    with Image.open(out) as picture:
        assert picture.size == (WIDTH, HEIGHT)


def test_overrides_reach_the_computation(run: Run, files: Files) -> None:
    common = ["psf", *files.sources, "--duration", DURATION, "--bands", 4, "--strips", 1, "--json"]
    plain = json.loads(run(*common, "--start", START).stdout)
    moved = json.loads(run(*common, "--start", START + 0.1, "--time-offset", 0.1).stdout)
    still = json.loads(run(*common, "--start", START, "--readout-time", 0).stdout)
    # A log and an exposure moved alike give the same paths, up to the rounding of times.
    assert moved["path_px"]["longest"] == pytest.approx(plain["path_px"]["longest"], rel=1e-6)
    assert still["path_px"]["longest"] != pytest.approx(plain["path_px"]["longest"], rel=1e-3)


def test_a_drift_moves_the_kernels(run: Run, files: Files) -> None:
    files.write_gyro(files.samples() * (1, 0, 0, 0))
    common = ["psf", *files.recording, "--bands", 4, "--strips", 1, "--json"]
    # A kernel has a pixel on both sides.
    for more, size in (([], [3, 3]), (["--drift", "9,-5"], [11, 7])):
        assert json.loads(run(*common, *more).stdout)["psf_px"] == size
    for more, message in (
        (["--drift", "8"], "3,-2"),
        (["--drift", "1e9,0"], "--drift: px must not be beyond 1e+06"),
    ):
        assert message in run(*common, *more).stderr


def test_info_shows_the_accelerometer_and_names_a_trajectory(run: Run, tmp_path: Path) -> None:
    log, track = tmp_path / "gyro_accel.csv", tmp_path / "poses.txt"
    timestamps = [0.5 + 0.01 * i for i in range(9)]
    log.write_text("t[s],gx,gy,gz,ax[g],ay[g],az[g]\n" + "".join(f"{t},0,0,0,0,1,0\n" for t in timestamps))
    track.write_text("".join(f"{t} {t} 0 0 0 0 0 1\n" for t in timestamps))
    gyro, poses = json.loads(run("info", log, track, "--json").stdout)["files"]
    assert (gyro["kind"], poses["kind"]) == ("gyro log", "not understood")
    assert "looks like a trajectory" in poses["reason"]
    assert gyro["gravity_m_s2"] == pytest.approx(9.80665)


def test_compare_writes_pictures_facts_and_a_report(run: Run, files: Files, tmp_path: Path) -> None:
    out, page = tmp_path / "new" / "out", tmp_path / "report.html"
    # Rates as if in degrees, with a unit: accepted with a warning, which the report repeats.
    files.write_gyro(files.samples() * [1, 6, 6, 6])
    options = ["--unit", "rad/s", "--drift", "1,-2", "--truth", files.photo, "-o", out, "--report", page]
    result = run("compare", files.photo, *files.recording, *options)
    assert result.exit_code == 0, result.stderr
    names = {"global.png", "banded.png", "rowwise.png", "side-by-side.png", "psfs.png", "compare.json"}
    assert {path.name for path in out.iterdir()} == names
    report = json.loads((out / "compare.json").read_text())
    assert (report["size_px"], report["report"]) == ([WIDTH, HEIGHT], str(page))
    assert report["blurred"]["ssim"] == pytest.approx(1.0)
    for mode in ("global", "banded", "rowwise"):
        found = report["modes"][mode]
        assert found["psnr_db"] > 5.0
        assert [mode, "hyper-laplacian"] in [line.split()[:2] for line in result.stdout.splitlines()]
    assert (report["modes"]["global"]["bands"], report["modes"]["global"]["strips"]) == (1, 1)
    assert f"Open {page}" in result.stdout
    text = page.read_text("utf-8")
    assert "degrees per second" in result.stderr
    assert text.count("gyro rates look like degrees per second") == 1
    for label in ("input", "global", "banded", "rowwise", "truth"):
        assert f'data-label="{label}"' in text
    # Folders may be private.
    assert files.gyro.name in text
    assert str(files.gyro) not in text
    assert re.search(r"<dt>prior</dt><dd>hyper-laplacian</dd>", text)
    assert re.search(r"<dt>drift</dt><dd>1  -2</dd>", text)


def test_psf_draws_and_saves(run: Run, files: Files, tmp_path: Path) -> None:
    drawing, bank, paths = tmp_path / "psfs.png", tmp_path / "psfs.npz", tmp_path / "paths.csv"
    result = run(
        "psf", *files.recording, "--bands", 4, "--strips", 2, "-o", drawing, "--bank", bank,
        "--picture", files.photo, "--path", paths, "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    report = json.loads(result.stdout)
    loaded = PsfBank.load(bank)
    assert loaded.kernels.shape[:2] == (report["bands"], report["strips"]) == (4, 2)
    assert report["psf_px"] == [loaded.size[1], loaded.size[0]]
    assert 0.0 < report["path_px"]["shortest"] <= report["path_px"]["longest"]
    with Image.open(drawing) as picture:
        assert picture.mode == "RGB"
    table = np.loadtxt(paths, delimiter=",", skiprows=1).reshape(4, 2, -1, 5)
    np.testing.assert_allclose(table[..., 3:], loaded.displacements, rtol=1e-8, atol=1e-12)  # nine digits
    np.testing.assert_allclose(table[:, :, 0, :2], loaded.centres, rtol=1e-8)
    assert np.ptp(table[0, 0, :, 2]) == pytest.approx(DURATION)


@pytest.mark.parametrize("suffix", [".png", ".npy", ".npz"])
def test_a_parametric_kernel_is_one_for_deblur(run: Run, files: Files, tmp_path: Path, suffix: str) -> None:
    kernel, out = tmp_path / f"kernel{suffix}", tmp_path / "o.png"
    shape = ("--line", "5,30", "--disc", 2, "--gauss", 0.8)
    assert run("psf", *shape, "-o", kernel, "--json").exit_code == 0
    expected = PsfBank.parametric(line=(5, 30), disc=2, gauss=0.8).kernels
    # 16 bits of the peak, which is 0.1.
    np.testing.assert_allclose(read_psfs(kernel, (48, 64)).kernels, expected, atol=2e-6)
    assert run("deblur", files.photo, "--psf", kernel, "--prior", "wiener", "-o", out).exit_code == 0
    refused = run("psf", *shape, "--gyro", files.gyro, "-o", kernel, "--force")
    assert (refused.exit_code, "no meaning: --gyro" in refused.stderr) == (2, True)


def test_simulate_writes_three_pictures(run: Run, files: Files, tmp_path: Path) -> None:
    result = run("simulate", files.photo, *files.recording, "--noise", 0.01, "--bits", 16)
    assert result.exit_code == 0, result.stderr
    assert {path.name for path in (tmp_path / "photo-simulated").iterdir()} == {
        "blurred.png",
        "rectified.png",
        "rolling.png",
    }
    with Image.open(files.photo) as sharp, Image.open(tmp_path / "photo-simulated" / "rectified.png") as rectified:
        difference = np.asarray(rectified, dtype=float) - np.asarray(sharp, dtype=float)
    # The rectified reference is the scene itself; 16 bits read as 8 may round the other way.
    assert np.abs(difference).max() <= 1.0


def test_info_recognises_the_kinds(run: Run, files: Files) -> None:
    result = run("info", *files, "--json")
    assert result.exit_code == 0, result.stderr
    picture, gyro, camera, captures = entries = json.loads(result.stdout)["files"]
    assert [entry["kind"] for entry in entries] == ["picture", "gyro log", "camera", "captures"]
    assert picture["size_px"] == [WIDTH, HEIGHT]
    assert gyro["rate_hz"] == pytest.approx(200.0)
    assert camera["readout_time_s"] == 0.03
    assert captures["count"] == 3
    text = run("info", *files).stdout
    assert all(f"{path}: " in text for path in files)


def test_info_reports_coverage_and_suspicious_units(run: Run, files: Files) -> None:
    result = run("info", *files.sources, "--capture", files.captures, "--json")
    (entry,) = json.loads(result.stdout)["files"]
    states = [exposure["coverage"] for exposure in entry["exposures"]]
    assert states[:2] == ["complete", "complete"]
    assert "misses" in states[2]
    text = files.gyro.read_text().splitlines()
    degrees = [",".join([line.split(",")[0], "80.0", "0.0", "0.0"]) for line in text[1:]]
    files.gyro.write_text("\n".join([text[0], *degrees]) + "\n")
    (entry,) = json.loads(run("info", files.gyro, "--unit", "rad/s", "--json").stdout)["files"]
    assert "degrees" in " ".join(entry["remarks"])


def test_demo_runs_and_its_command_works(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    out = Path("demo")
    result = run("demo", "--size", "128x96")
    assert result.exit_code == 0, result.stderr
    report = json.loads((out / "compare.json").read_text())
    assert report["modes"]["banded"]["psnr_db"] > report["blurred"]["psnr_db"]
    program, *arguments = shlex.split(result.stdout.splitlines()[-1])
    assert program == "rsdeblur"
    assert run(*arguments).exit_code == 0
    assert bits(out / "again.png") == bits(out / "banded.png")


@pytest.mark.parametrize("arguments", [["--size", "63x64"], ["--size", "100000x1000"], ["--size", "81x80", "--video"]])
def test_the_demo_refuses_sizes_before_it_writes(run: Run, tmp_path: Path, arguments: list[str]) -> None:
    assert run("demo", *arguments, "-o", tmp_path / "demo").exit_code in (1, 2)
    assert not list(tmp_path.glob("demo/*"))


def test_own_kernels(run: Run, files: Files, tmp_path: Path) -> None:
    kernel, folder = tmp_path / "kernel.npy", tmp_path / "new"
    np.save(kernel, np.eye(5))
    call = ["deblur", files.photo, "--psf", kernel, "--prior", "wiener", "-o", folder]
    for scale, size in (((), 5), (("--psf-scale", 1.5), 7)):
        assert f"global, PSFs of up to {size} x {size} px" in run(*call, *scale, "--dry-run").stdout
    assert not folder.exists()
    result = run(*call)
    assert result.exit_code == 0, result.stderr
    photo = np.asarray(Image.open(files.photo))
    expected = np.empty_like(photo)
    deconvolve(photo, np.eye(5) / 5, prior="wiener", out=expected)
    np.testing.assert_array_equal(np.asarray(Image.open(folder / files.photo.name)), expected)
    wrong = run("deblur", files.photo, "--gyro", files.gyro, "--psf-scale", 1.5, "-o", folder)
    assert (wrong.exit_code, "--psf-scale is for --psf" in wrong.stderr) == (2, True)


def test_sync_refuses_to_guess(run, files, monkeypatch):
    def unsure(_, log, camera, exposure, *, search=(-0.06, 0.06), **__):
        return OffsetSearch(None, 0.005, 0.001, 0.0, "the scene is without detail", np.zeros(1), np.zeros(1), camera)

    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", unsure)
    before = files.camera.read_text()
    result = run("sync", files.photo, *files.recording, "--from", "-20ms", "--to", "20ms", "--write", "--json")
    assert result.exit_code == 1
    assert "does not determine the time offset" in result.stderr
    assert json.loads(result.stdout)["time_offset_s"] is None
    assert files.camera.read_text() == before


def test_sync_writes_only_into_files_that_have_a_place_for_it(run, files, tmp_path, monkeypatch):
    foreign = tmp_path / "lens.json"
    foreign.write_text("{}")
    # Before the search, whose answer would be lost.
    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", None)
    sources = ["--gyro", files.gyro, "--camera", foreign]
    result = run("sync", files.photo, *sources, "--start", "0.1", "--duration", "0.05", "--write")
    assert result.exit_code == 1
    assert str(foreign) in result.stderr
    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", found_offset(0.0125))
    call = ("sync", files.photo, *files.recording, "--from", "-20ms", "--to", "20ms", "--json")
    for more, written in (((), None), (("--write",), str(files.camera))):
        assert json.loads(run(*call, *more).stdout)["written"] == written
        assert read_camera(files.camera).time_offset == (0.0125 if written else 0.0)


@pytest.mark.parametrize("command", ["deblur", "batch"])
def test_several_photos(run: Run, files: Files, tmp_path: Path, here: None, command: str) -> None:
    names = [tmp_path / name for name in ("frame_0.png", "frame_1.png", "frame_2.png")]
    for name in names:
        name.write_bytes(files.photo.read_bytes())
    capture = ["--capture", files.captures, "--quality", "fast"]
    # The log does not cover the last frame.
    result = run(command, *names, *files.sources, *capture, "-o", tmp_path / "sharp", "--json")
    assert result.exit_code == 3
    entries = json.loads(result.stdout)["items"]
    assert [("error" in entry) for entry in entries] == [False, False, True]
    assert sorted(path.name for path in (tmp_path / "sharp").glob("*.png")) == ["frame_0.png", "frame_1.png"]

    # Names that leave the number of the first frame open.
    call = [command, *names[1:], *files.sources, *capture, "-o", tmp_path / "later"]
    assert "give --numbered-from 0 or 1" in run(*call).stderr
    assert run(*call, "--numbered-from", "1").exit_code == 0
    first, later = (read_picture(tmp_path / name).pixels for name in ("sharp/frame_0.png", "later/frame_1.png"))
    np.testing.assert_array_equal(later, first)
    # Without another exposure, that of EXIF, which these photos do not have.
    result = run(command, *names, *files.sources, "-o", tmp_path / "none")
    assert (result.exit_code, result.stderr.count("the exposure is missing")) == (3, 3)
    assert "--start is one moment" in run(command, *names, *files.recording, "-o", tmp_path / "none").stderr


def test_where_the_result_of_a_photo_goes(run: Run, files: Files, tmp_path: Path) -> None:
    call = ["deblur", files.photo, *files.sources, "--capture", files.captures, "--index", "0", "--quality", "fast"]
    # Beside the photo, or into a folder that need not exist.
    assert run(*call).exit_code == run(*call, "-o", tmp_path / "new").exit_code == 0
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["photo.png"]
    assert bits(tmp_path / "photo-sharp.png") == bits(tmp_path / "new" / "photo.png")


def test_times_from_exif(run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noon_ns, late = 1_766_385_749_000_000_000, 0.5
    samples = files.samples()
    rows = [f"{noon_ns + round(1e9 * t)},{x},{y},{z}" for t, x, y, z in samples]
    log = tmp_path / "Gyroscope.csv"
    log.write_text("\n".join(["time,x,y,z", *rows]) + "\n")
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x9003: "2025:12:22 08:42:29", 0x9291: f"{round(1e3 * (START + late))}"})
    exif.get_ifd(0x8769)[0x829A] = DURATION
    photo = tmp_path / "IMG_1.jpg"
    Image.open(files.photo).save(photo, exif=exif, quality=98)
    # A picture of noise determines no offset; the search itself has its own tests.
    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", found_offset(late))
    base = ["deblur", photo, "--gyro", log, "--camera", files.camera, "--quality", "fast"]
    without = run("deblur", files.photo, *base[2:], "--start", "exif", "--duration", "1/25", "-o", tmp_path / "a.png")
    assert without.exit_code == 1
    assert without.stderr.count(str(files.photo)) == 1
    result = run(*base, "--start", "exif", "-o", tmp_path / "a.png")
    assert "The exposure began 0.500 s before the time in EXIF." in result.stdout
    compared = run("compare", *base[1:-2], "--start", "exif", "--mode", "global", "-o", tmp_path / "compared")
    assert "The exposure began 0.500 s before the time in EXIF." in compared.stdout
    start_ns = noon_ns + round(1e9 * START)
    assert run(*base, "--start-ns", start_ns, "-o", tmp_path / "b.png").exit_code == 0
    np.testing.assert_array_equal(read_picture(tmp_path / "a.png").pixels, read_picture(tmp_path / "b.png").pixels)
    # Without options, EXIF gives moment and camera, if it has a focal length.
    alone = ["deblur", photo, "--gyro", log, "--quality", "fast", "-o", tmp_path / "c.png"]
    assert "give a camera file" in run(*alone).stderr
    exif.get_ifd(0x8769)[0xA405] = 40
    Image.open(files.photo).save(photo, exif=exif, quality=98)
    saved = tmp_path / "saved.toml"
    assert "The exposure began 0.500 s before the time in EXIF." in run(*alone, "--save-camera", saved).stdout
    # How far EXIF is from the moment belongs to the photo, the guess of the readout to the camera.
    with pytest.warns(RsdeblurWarning, match="readout time is unknown"):
        camera = read_camera(saved)
    assert (camera.time_offset, camera.readout_sd) == (0.0, 0.01)
    assert "exists" in run(*alone, "--save-camera", saved).stderr
    # A folder with a log and such photos is a session, too.
    session = tmp_path / "session"
    session.mkdir()
    log.rename(session / log.name)
    photo.rename(session / photo.name)
    listed = run("triage", session, "--camera", files.camera, "--json")
    # The moment in EXIF is beyond the log, which names what is missing.
    (item,) = json.loads(listed.stdout)["items"]
    assert (Path(item["photo"]).name, "misses" in item["reason"]) == (photo.name, True)


def test_an_archive_of_photos_named_by_unix_time_is_a_session(run, here, files, tmp_path: Path, monkeypatch) -> None:
    start_ns = 1_766_385_749_000_000_000
    rows = [f"{start_ns + round(1e9 * t)},{x},{y},{z}" for t, x, y, z in files.samples()]
    name = f"{start_ns // 10**6 + round(1e3 * START)}.png"
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("Gyroscope.csv", "\n".join(["time,x,y,z", *rows]) + "\n")
        archive.write(files.photo, f"Camera/{name}")
    # A picture of noise determines no offset; the search itself has its own tests.
    monkeypatch.setattr("rsdeblur.estimate.time_offset.find_time_offset", found_offset(0.0))
    call = ["batch", tmp_path / "walk.zip", "--camera", files.camera, "--duration", DURATION, "--quality", "fast"]
    assert "No such file" in run("batch", tmp_path / "nope.zip").stderr
    (item,) = json.loads(run(*call, "--jobs", 1, "--json").stdout)["items"]
    assert (item["state"], item["output"]) == ("done", str(tmp_path / "walk-sharp" / "Camera" / name)), item
    # What was unpacked is the same next time.
    (item,) = json.loads(run(*call, "--jobs", 1, "--json").stdout)["items"]
    assert item["state"] == "skipped"
