"""`rsdeblur video` by default: only blurred frames change, and motion data stay."""

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, GyroLog, InputError
from rsdeblur.choices import VERDICTS
from rsdeblur.simulation.scene import scene
from tests.cli.clips import write_clip
from tests.installed import needs

av = needs("video")

from rsdeblur.pipeline.options import Options  # noqa: E402 (with PyAV, like the rest)
from rsdeblur.video.clip import open_clip  # noqa: E402
from rsdeblur.video.plan import ClipPlan, plan_clip  # noqa: E402

Run = Callable[..., Result]

WIDTH, HEIGHT, FRAMES, FOCAL, DURATION = 64, 48, 8, 100.0, 0.01
# Paths in px of the frames, which are 0.1 s apart: at most 1.5 px is no blur, and 3 px and more is full blur.
LENGTHS = (0.0, 0.5, 1.3, 2.25, 4.0, 2.0, 0.0, 0.0)
GPMF = [b"DEVC" + bytes([i] * 12) for i in range(FRAMES)]


def write(path: Path, codec: str, pixels: str) -> None:
    """Write a video of a still scene, with motion data if it is an MP4."""
    picture = scene(64, 64, seed=1)[:HEIGHT]
    data = GPMF if path.suffix == ".mp4" else ()
    write_clip(path, [picture] * FRAMES, codec=codec, pixels=pixels, rate=10, data=data, max_b_frames=0)


@pytest.fixture
def recording(tmp_path: Path) -> list[object]:
    """Write a log in which frame i is blurred by `LENGTHS[i]`; return the options of every call."""
    t = np.arange(0.0, 1.0, 0.001)
    rates = np.interp(t, 0.055 + 0.1 * np.arange(FRAMES), np.array(LENGTHS) / (FOCAL * DURATION))
    # Constant while the rows of a frame are exposed.
    for i, length in enumerate(LENGTHS):
        rates[(t > 0.03 + 0.1 * i) & (t < 0.08 + 0.1 * i)] = length / (FOCAL * DURATION)
    table = np.column_stack([t, 0 * t, rates, 0 * t])
    np.savetxt(tmp_path / "gyro.csv", table, "%.6f", ",", header="t,wx,wy,wz", comments="")
    Camera(WIDTH, HEIGHT, FOCAL).save(tmp_path / "camera.toml")
    files = ["--gyro", tmp_path / "gyro.csv", "--camera", tmp_path / "camera.toml"]
    return [*files, "--start", 0.05, "--duration", DURATION, "--nsr", 0.01, "--jobs", 1]


def decoded(path: Path) -> tuple[str, list[NDArray[Any]]]:
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
        return frames[0].format.name, [frame.to_ndarray() for frame in frames]


def test_only_blurred_frames_change(run: Run, recording: list[object], tmp_path: Path) -> None:
    clip, out = tmp_path / "clip.mkv", tmp_path / "out.mkv"
    write(clip, "ffv1", "yuv422p10le")
    dry = run("video", clip, *recording, "--dry-run", "--json", "-o", out)
    assert dry.exit_code == 0, dry.output
    result = run("video", clip, *recording, "--json", "-o", out)
    assert result.exit_code == 0, result.output
    facts, expected = json.loads(result.stdout), json.loads(dry.stdout)
    for found in (facts, expected):
        assert (found["treated"], found["kept"]) == (3, 5)
        # At the picture's side the path is longer than in its centre, by 1 + (32 / 100)^2.
        assert 4.0 <= found["largest_blur_px"] < 4.5
        assert found["check"]["verdict"] in VERDICTS
    (before_format, before), (after_format, after) = decoded(clip), decoded(out)
    assert after_format == before_format == "yuv422p10le"
    # FFV1 is lossless.
    changed = [not np.array_equal(a, b) for a, b in zip(before, after, strict=True)]
    assert changed == [False, False, False, True, True, True, False, False]


def test_frames_of_rgb_are_stored_alike(run: Run, recording: list[object], tmp_path: Path) -> None:
    clip, out = tmp_path / "clip.mkv", tmp_path / "out.mkv"
    write(clip, "ffv1", "bgr0")
    still = tmp_path / "still.csv"
    np.savetxt(still, np.column_stack([np.arange(0.0, 1.0, 0.005), np.zeros((200, 3))]), "%.6f", ",")
    means = []
    for more in ((), ("--above", 0, "--gyro", still)):  # the first frame is kept, then deblurred
        options = ("--codec", "libx264", "--crf", 1, "--force", "-o", out, *more)
        result = run("video", clip, *recording, *options)
        assert result.exit_code == 0, result.output
        with av.open(str(out)) as container:
            frame = next(container.decode(video=0))
        # RGB has no matrix that YCbCr could have.
        assert (frame.format.name, int(frame.colorspace)) == ("yuv444p", 1)
        means.append(frame.to_ndarray().astype(float).mean(axis=(1, 2)))
    np.testing.assert_allclose(*means, atol=0.1)  # levels


def test_motion_data_stay(run: Run, recording: list[object], tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    write(clip, "libx264", "yuv420p")
    for name, kept in (("out.mp4", GPMF), ("out.mkv", [])):
        result = run("video", clip, *recording, "--json", "-o", tmp_path / name)
        assert result.exit_code == 0, result.output
        assert json.loads(result.stdout)["dropped"] == ([] if kept else ["data"])
        with av.open(str(tmp_path / name)) as container:
            packets = list(container.demux(container.streams.data)) if kept else []
            assert [bytes(packet) for packet in packets if packet.size] == kept
            assert [packet.pts * packet.time_base for packet in packets if packet.size] == [
                Fraction(i, 10) for i in range(len(kept))
            ]


def test_the_share_grows_with_the_blur(tmp_path: Path) -> None:
    clip = tmp_path / "clip.mkv"
    write(clip, "ffv1", "yuv420p")
    t = np.arange(0.0, 1.0, 0.001)
    omega = np.zeros((len(t), 3))
    omega[:, 1] = np.linspace(0.0, 4.0, len(t))
    exposures = [Exposure(0.05 + time, DURATION) for time in open_clip(clip).times]

    def planned(above: float) -> ClipPlan:
        options = Options(prior="wiener", nsr=0.01, threads=1, check=False)
        camera = Camera(WIDTH, HEIGHT, FOCAL)
        return plan_clip(open_clip(clip), GyroLog(t, omega), camera, exposures, options, above=above)

    plan = planned(1.0)
    np.testing.assert_allclose(plan.shares, np.clip(np.array(plan.lengths) - 1.0, 0.0, 1.0))
    assert plan.shares[0] == 0.0 < plan.shares[3] < plan.shares[-1] == 1.0
    assert set(planned(0.0).shares) == {1.0}
    with pytest.raises(InputError, match=r"no frame is blurred by more than 9 px, the largest blur is 3\.\d px"):
        planned(9.0)
    with pytest.raises(InputError, match="above must be"):
        planned(-1.0)
