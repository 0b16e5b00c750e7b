"""`rsdeblur calibrate`: photos and videos give a camera file, and what cannot be trusted is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, hand_shake, scene, simulate_clip, write_picture
from rsdeblur.cli.calibrate import RUN, _runs

Run = Callable[..., Result]

FRAMES, RATE, DURATION = 14, 30, 0.02
EPOCH = 5_000_000_000  # ns
TRUTH = Camera(176, 128, 190.0, readout_time=0.024, imu_to_camera="phone-landscape", time_offset=0.05)


class Film(NamedTuple):
    """Files of a clip."""

    folder: Path
    photos: list[Path]
    gyro: Path
    capture: Path
    pictures: list[NDArray[np.uint8]]


@pytest.fixture(scope="module")
def film(tmp_path_factory) -> Film:
    folder = tmp_path_factory.mktemp("film")
    log = hand_shake(2.6, strength=0.5, seed=5)
    exposures = [Exposure(1.0 + i / RATE, DURATION) for i in range(FRAMES)]
    frames = simulate_clip(scene(256, 352), log, TRUTH, exposures, noise=0.003, samples=4)
    pictures = [np.round(255 * frame.clip(0, 1) ** (1 / 2.2)).astype(np.uint8) for frame in frames]
    photos = [folder / f"photo{i:02d}.png" for i in range(FRAMES)]
    for path, picture in zip(photos, pictures, strict=True):
        write_picture(path, picture)
    np.savetxt(
        folder / "gyro.csv", np.column_stack([log.t + 5.0, log.omega]), "%.9f", ",", header="t,wx,wy,wz", comments=""
    )
    # A photo of the burst was not kept: the capture file has one line more at the start.
    stamps = [EPOCH + round(1e9 * (1.0 + i / RATE)) for i in range(-1, FRAMES)]
    (folder / "images.txt").write_text("".join(f"{stamp} {round(1e9 * DURATION)}\n" for stamp in stamps))
    return Film(folder, photos, folder / "gyro.csv", folder / "images.txt", pictures)


def test_photos_give_a_camera_file(run: Run, film: Film, tmp_path):
    output = tmp_path / "camera.toml"
    options = ("--gyro", film.gyro, "--capture", film.capture, "--index", 1, "-o", output)
    result = run("calibrate", *film.photos, *options)
    assert result.exit_code == 0, result.output
    for text in ("XYZ", "top-down", "determined", "assumed", "time offset", "bias z", "written"):
        assert text in result.stdout
    camera = Camera.load(output)
    # The requirements; the guess of the focal length, 0.8 of the width, is 26 % too short.
    assert camera.time_offset == pytest.approx(TRUTH.time_offset, abs=1e-3)
    assert camera.focal_length[0] == pytest.approx(190.0, rel=0.01)
    assert camera.readout_time == pytest.approx(0.024, rel=0.05)
    assert run("calibrate", *film.photos, *options).exit_code == 1  # the file exists


def test_a_refused_fit_writes_nothing(run: Run, film: Film, tmp_path):
    output = tmp_path / "camera.toml"
    options = ("--gyro", film.gyro, "--capture", film.capture, "--index", 1, "-o", output, "--json")
    result = run("calibrate", *film.photos[:4], *options)
    assert result.exit_code == 1
    assert "no camera file is written: only 3 pairs" in result.stderr
    facts = json.loads(result.stdout)
    assert (facts["accepted"], facts["written"], facts["pairs"]) == (False, None, 3)
    assert not output.exists()


def test_usage(run: Run, film: Film, tmp_path):
    options = ("--gyro", film.gyro, "-o", tmp_path / "camera.toml")
    result = run("calibrate", *film.photos, *options)
    assert result.exit_code == 2
    assert "photos need --capture" in result.stderr
    result = run("calibrate", *film.photos, *options, "--capture", film.capture, "--index", 9)
    assert result.exit_code == 1
    assert "there are 14 photos" in result.stderr


@pytest.mark.parametrize(("length", "count"), [(90, 128), (128, 128), (129, 128), (5000, 128), (100, 16), (100, 40)])
def test_a_long_clip_is_used_in_runs(length, count):
    """All frames of a short clip; of a long one, disjoint runs from its first frame to its last."""
    runs = _runs(length, count)
    numbers = [i for run in runs for i in run]
    assert len(set(numbers)) == len(numbers) == min(length, count // RUN * RUN if length > count else length)
    assert numbers == sorted(numbers)
    assert numbers[0] == 0
    assert len(runs) == 1 or numbers[-1] == length - 1


def test_a_video(run: Run, film: Film, tmp_path):
    av = pytest.importorskip("av", reason="the extra [video] is not installed")
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=RATE, options={"crf": "4"})
        stream.width, stream.height, stream.pix_fmt = 176, 128, "yuv444p"
        stream.codec_context.time_base = Fraction(1, RATE)
        for i, picture in enumerate(film.pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = i
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    output = tmp_path / "camera.toml"
    start = tmp_path / "start.toml"
    # The log starts at 5 s, so the first frame is 6 s on its clock; the search is around the start's offset.
    Camera(176, 128, 170.0, time_offset=0.3).save(start)
    options = ("--gyro", film.gyro, "--camera", start, "--start", 6.0, "--duration", DURATION, "-o", output, "--json")
    result = run("calibrate", path, *options, "--from", "-400ms", "--to", "100ms")
    assert result.exit_code == 0, result.stderr
    facts = json.loads(result.stdout)
    assert facts["written"] == str(output)
    assert facts["mounting"] == "XYZ"
    assert facts["values"]["time_offset"]["determined"]
    assert facts["values"]["time_offset"]["value"] == pytest.approx(TRUTH.time_offset, abs=1e-3)
