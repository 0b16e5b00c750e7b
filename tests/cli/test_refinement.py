"""The correction of the recording by the picture, and gravity, which shows wrong axes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import Camera, Correction, Exposure, read_camera, read_gyro
from rsdeblur.estimate import Refinement
from rsdeblur.motion.axes import imu_to_camera
from tests.cli.clips import write_clip


@pytest.fixture
def refined(files, monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Refine at once, and return for each time whether the axes were taken for known."""
    calls = []

    def refine(*_: object, known_axes: bool, **__: object) -> Refinement:
        calls.append(known_axes)
        given = read_gyro(files.gyro), read_camera(files.camera), Exposure(0.2, 0.04), None
        return Refinement(*given, False, "it is right", Correction(), Correction(), 0.0, 0.0, 0.0)

    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", refine)
    return calls


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), True),
        (("--no-refine",), False),
        (("--quality", "fast"), False),
        (("--quality", "fast", "--refine"), True),
        (("--max-memory", "1GiB"), False),
    ],
)
def test_recordings_are_refined_unless_that_is_slow_or_impossible(
    run, files, refined, tmp_path: Path, options: tuple[str, ...], expected: bool
) -> None:
    call = "deblur", files.photo, *files.recording, "--force", *options, "-o", tmp_path / "sharp.png"
    facts = json.loads(run(*call, "--json").stdout)
    assert (facts["refinement"] is not None) == bool(refined) == expected
    # Why a recording stays as it is interests who asked for more.
    assert ("it is right" in run(*call).stdout) == ("--refine" in options)


def write_log(path: Path, samples: np.ndarray, force: list[float]) -> None:
    """Write the log of a phone with an accelerometer."""
    t, *rates = samples.T
    table = np.column_stack([np.round(t * 1e9), *rates, np.broadcast_to(force, (len(t), 3))])
    header = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]"
    np.savetxt(path, table, ["%d", *["%.6f"] * 6], ", ", header=header, comments="")


@pytest.mark.parametrize(
    ("orientation", "preset", "side"),
    [
        (1, "phone-portrait", None),
        (1, "phone-landscape", "right"),
        (6, "phone-portrait", "left"),
        (3, "phone-portrait-reversed", None),
        (5, "phone-portrait", None),  # mirrored: nothing is known
    ],
)
def test_gravity_names_wrong_axes_which_are_not_refined(
    run, files, refined, tmp_path: Path, orientation: int, preset: str, side: str | None
) -> None:
    write_log(files.gyro, files.samples(), [0.0, 9.8, 0.5])  # a phone held upright
    replace(read_camera(files.camera), imu_to_camera=imu_to_camera(preset)).save(files.camera)
    exif = Image.Exif()
    exif[0x0112] = orientation
    with Image.open(files.photo) as picture:
        picture.save(files.photo, exif=exif)
    call = "deblur", files.photo, *files.recording, "--quality", "fast", "--force", "-o", tmp_path / "sharp.png"
    warned = run(*call).stderr
    assert (f"points to the {side} of" in warned) == ("gravity points" in warned) == (side is not None)
    if side is not None:
        # "gyroflow" fits like "phone-landscape", but is for other logs.
        assert f"wrong ({ {1: 'phone-portrait', 6: 'phone-landscape'}[orientation] } fits)" in warned
        assert "deblurred with the axes phone-" in warned
    assert "deblurred with" not in run(*call, "--refine").stderr
    # Other axes are only tried where gravity says nothing.
    assert refined == [side is None and orientation != 5]
    # `compare` sees the same.
    options = ("--mode", "banded", "--quality", "fast", "-o", tmp_path / "compared")
    assert run("compare", files.photo, *files.recording, *options).stderr == warned


@pytest.mark.parametrize("mounting", [np.diag([-1.0, -1.0, 1.0]), np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]])])
def test_a_camera_on_another_side_of_the_phone_is_turned_to_its_back(
    run, files, refined, tmp_path: Path, mounting: np.ndarray
) -> None:
    write_log(files.gyro, files.samples(), [0.0, 9.8, 0.5])
    replace(read_camera(files.camera), imu_to_camera=mounting).save(files.camera)
    warned = run("deblur", files.photo, *files.recording, "--quality", "fast", "-o", tmp_path / "sharp.png").stderr
    assert "the camera would look" in warned
    assert "deblurred with the axes phone-portrait" in warned


@pytest.mark.parametrize(
    ("rotation", "force", "preset", "side"),
    [
        (0, [9.8, 0.0, 0.5], "phone-landscape", None),
        (0, [9.8, 0.0, 0.5], "phone-landscape-reversed", "top"),
        (-90, [9.8, 0.0, 0.5], "phone-landscape", "left"),
        (0, [0.0, 0.5, 9.8], "phone-portrait", None),  # it looks down: nothing is known
    ],
)
def test_gravity_names_wrong_axes_of_a_video(
    run, tmp_path: Path, rotation: int, force: list[float], preset: str, side: str | None
) -> None:
    noise = np.random.default_rng(0).integers(60, 200, (48, 64, 3)).astype(np.uint8)
    clip = write_clip(tmp_path / "clip.mp4", [noise] * 8, turn=rotation)
    t = np.arange(0.0, 1.0, 0.005)
    write_log(tmp_path / "gyro.csv", np.column_stack([t, np.sin(20 * t), 0.5 * np.cos(9 * t), 0 * t]), force)
    Camera(64, 48, 70.0, readout_time=0.01, imu_to_camera=preset).save(tmp_path / "camera.toml")
    sources = ["--gyro", tmp_path / "gyro.csv", "--camera", tmp_path / "camera.toml", "--start", 0.1]
    for arguments in (
        ["video", clip, "--above", 0, "--dry-run", "-o", tmp_path / "out.mp4"],
        ["burst", "--from", clip, "--frames", "2:4", "-o", tmp_path / "out.png"],
    ):
        result = run(*arguments, *sources, "--duration", "1/60", "--nsr", "0.01")
        assert result.exit_code == 0, result.output
        assert (f"gravity points to the {side} of {clip}" in result.stderr) == (side is not None)
        assert ("gravity points" in result.stderr) == (side is not None)
