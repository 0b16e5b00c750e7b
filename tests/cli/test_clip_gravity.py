"""Wrong axes of a video, which gravity contradicts: `video` and `burst --from` warn as `deblur` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rsdeblur import Camera
from tests.installed import needs

av = needs("video")

Run = Callable[..., Result]

WIDTH, HEIGHT, FRAMES = 64, 48, 8


def write(path: Path, rotation: int) -> None:
    """Write a video that viewers turn."""
    noise = np.random.default_rng(0).integers(60, 200, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.set_display_rotation(rotation)
        for _ in range(FRAMES):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(noise, format="rgb24")))
        container.mux(stream.encode())


def record(folder: Path, force: list[float], preset: str) -> list[object]:
    """Write a phone's log with an accelerometer and a camera; return the options that name them."""
    t = np.arange(0.0, 1.0, 0.005)
    table = np.column_stack(
        [np.round(1e9 * t), np.sin(20 * t), 0.5 * np.cos(9 * t), 0 * t, np.broadcast_to(force, (len(t), 3))]
    )
    header = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]"
    np.savetxt(folder / "gyro.csv", table, ["%d", *["%.6f"] * 6], ", ", header=header, comments="")
    Camera(WIDTH, HEIGHT, 70.0, readout_time=0.01, imu_to_camera=preset).save(folder / "camera.toml")
    return ["--gyro", folder / "gyro.csv", "--camera", folder / "camera.toml", "--start", 0.1, "--duration", "1/60"]


@pytest.mark.parametrize(
    ("rotation", "force", "preset", "side"),
    [
        (0, [9.8, 0.0, 0.5], "phone-landscape", None),
        (0, [9.8, 0.0, 0.5], "phone-portrait", "left"),
        (0, [9.8, 0.0, 0.5], "phone-landscape-reversed", "top"),
        (-90, [0.0, 9.8, 0.5], "phone-landscape", None),
        (-90, [9.8, 0.0, 0.5], "phone-landscape", "left"),
        (180, [-9.8, 0.0, 0.5], "phone-landscape", None),
        (0, [0.0, 0.5, 9.8], "phone-portrait", None),  # it looks down: nothing is known
    ],
)
def test_gravity_names_wrong_axes(
    run: Run, tmp_path: Path, rotation: int, force: list[float], preset: str, side: str | None
) -> None:
    clip = tmp_path / "clip.mp4"
    write(clip, rotation)
    sources = record(tmp_path, force, preset)
    for arguments in (
        ["video", clip, *sources, "--above", 0, "--nsr", "0.01", "--dry-run", "-o", tmp_path / "out.mp4"],
        ["burst", "--from", clip, "--frames", "2:4", *sources, "--nsr", "0.01", "-o", tmp_path / "out.png"],
    ):
        result = run(*arguments)
        assert result.exit_code == 0, result.output
        assert ("gravity points to" in result.stderr) == (side is not None)
        assert side is None or f"gravity points to the {side} of {clip}" in result.stderr
