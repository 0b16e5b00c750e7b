"""Camera files: the commands create and import them, and warn about doubtful ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur import Camera, read_camera
from rsdeblur.motion.axes import imu_to_camera

if TYPE_CHECKING:
    from conftest import Files

# Values of the fixture `files`.
START, DURATION = 0.2, 0.04

Run = Callable[..., Result]


def test_new_names_what_it_assumes(run: Run, tmp_path: Path) -> None:
    result = run("camera", "new", "--size", "4000x3000", "--focal-length", "4.7", "-o", tmp_path / "new.toml")
    for text in ("readout time is unknown", "readout-times", "give --imu", "camera-file", "is it in mm?"):
        assert text in result.stdout


def test_new(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "new.toml"
    options = ("--readout-time", "18ms", "--readout-direction", "left-right", "--timestamp-marks", "middle")
    lens = ("--distortion-model", "radtan", "--distortion", "-0.1,0.01,0.001,0.002", "--principal-point", "200,149")
    result = run(
        "camera", "new", "--size", "400x300", "--focal-length", "410,411", "--imu", "YxZ", *options, *lens, "-o", out
    )
    assert result.exit_code == 0, result.stderr
    camera = read_camera(out)
    assert (camera.focal_length, camera.principal_point, camera.readout_time) == ((410.0, 411.0), (200.0, 149.0), 0.018)
    assert (camera.readout_direction, camera.timestamp_marks) == ("left-right", "middle")
    assert camera.distortion == (-0.1, 0.01, 0.001, 0.002)
    np.testing.assert_array_equal(camera.imu_to_camera, imu_to_camera("phone-portrait"))
    assert "phone-portrait" in result.stdout
    again = run("camera", "new", "--size", "400x300", "--focal35", "26", "-o", out)
    assert (again.exit_code, "the file exists" in again.stderr) == (1, True)


@pytest.mark.parametrize("focal_length", [[], ["--focal-length", "400", "--focal35", "26"], ["--focal-length", "a"]])
def test_new_needs_one_focal_length(run: Run, tmp_path: Path, focal_length: list[str]) -> None:
    assert run("camera", "new", "--size", "400x300", *focal_length, "-o", tmp_path / "new.toml").exit_code == 2


def test_a_camera_file_is_called_toml(run: Run, files: Files, tmp_path: Path) -> None:
    """All commands that write a camera file refuse another extension, before the work and even with --force."""
    out = tmp_path / "new.png"
    for arguments in (
        ("camera", "new", "--size", "400x300", "--focal35", "26"),
        ("calibrate", files.photo, "--gyro", files.gyro, "--capture", files.captures),
    ):
        result = run(*arguments, "-o", out, "--force")
        assert (result.exit_code, f"{out}: a camera file is TOML" in result.stderr) == (1, True)
        assert not out.exists()


def test_import_resizes_crops_and_turns(run: Run, tmp_path: Path) -> None:
    source, out = tmp_path / "a.toml", tmp_path / "b.toml"
    camera = Camera(400, 300, 410.0, readout_time=0.02, imu_to_camera="phone-landscape")
    camera.save(source)
    steps = ("--size", "200x150", "--crop", "100x80+20+30", "--turn", 1, "--time-offset", "-5ms")
    result = run("camera", "import", source, *steps, "-o", out)
    assert result.exit_code == 0, result.stderr
    expected, found = camera.resized(200, 150).cropped(20, 30, 100, 80).turned(), read_camera(out)
    assert (found.width, found.height, found.focal_length) == (80, 100, expected.focal_length)
    assert (found.readout_time, found.readout_direction) == (expected.readout_time, "right-left")
    np.testing.assert_allclose(found.imu_to_camera, imu_to_camera("phone-portrait"), atol=1e-15)
    assert found.time_offset == -0.005


def test_options_replace_assumptions_without_a_warning(run: Run, files: Files, tmp_path: Path) -> None:
    profile = tmp_path / "profile.json"
    lens = {"camera_matrix": [[110, 0, 48], [0, 110, 36], [0, 0, 1]], "distortion_coeffs": [0, 0, 0, 0]}
    profile.write_text(json.dumps({"calib_dimension": {"w": 96, "h": 72}, "fisheye_params": lens}))
    doubt = "the readout time is unknown"
    assert doubt in run("camera", "import", profile, "-o", tmp_path / "a.toml").stdout
    assert doubt not in run("camera", "import", profile, "--readout-time", "20ms", "-o", tmp_path / "b.toml").stdout
    recording = ["--gyro", files.gyro, "--camera", profile, "--start", START, "--duration", DURATION]
    assert doubt in run("psf", *recording, "-o", tmp_path / "a.png").stderr
    assert doubt not in run("psf", *recording, "--readout-time", "20ms", "-o", tmp_path / "b.png").stderr


def test_info_shows_a_camera_file(run: Run, files: Files) -> None:
    (shown,) = json.loads(run("info", files.camera, "--json").stdout)["files"]
    assert (shown["format"], shown["readout_time_s"]) == ("toml", 0.03)
    assert "readout_time_s: 0.03" in run("info", files.camera).stdout


def test_impossible_axes_cause_a_warning(run: Run, files: Files, tmp_path: Path) -> None:
    rows = [f"{round(1e9 * t)},{x},{y},{z}" for t, x, y, z in files.samples().tolist()]
    files.gyro.write_text("\n".join(["Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s]", *rows]) + "\n")
    call = ("psf", *files.recording)
    assert "is in phone axes; it should be phone-portrait or phone-landscape" in run(*call).stderr
    Camera(96, 72, 110.0, readout_time=0.03, imu_to_camera="phone-portrait").save(files.camera)
    assert run(*call).stderr == ""
    assert "imu_to_camera is that of a phone's axes" in run(*call, "--orientation", "XYZ").stderr


def test_the_exposure_time_may_come_from_exif(run: Run, files: Files, tmp_path: Path) -> None:
    with Image.open(files.photo) as image:
        exif = Image.Exif()
        exif[0x010F] = "Maker"
        exif.get_ifd(0x8769)[0x829A] = DURATION
        image.save(files.photo, exif=exif)
    timestamps = tmp_path / "timestamps.csv"
    timestamps.write_text(f"{round(1e9 * START)}\n")
    ways = files.recording, [*files.sources, "--start", START], [*files.sources, "--capture", timestamps]
    pictures = []
    for i, way in enumerate(ways):
        result = run("deblur", files.photo, *way, "--quality", "fast", "-o", tmp_path / f"{i}.png")
        assert result.exit_code == 0, result.stderr
        pictures.append(np.asarray(Image.open(tmp_path / f"{i}.png")))
    np.testing.assert_array_equal(pictures[0], pictures[1])
    np.testing.assert_array_equal(pictures[0], pictures[2])
