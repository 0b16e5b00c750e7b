"""`rsdeblur burst`."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import Camera, Exposure, hand_shake, read_picture, simulate_clip, write_picture
from rsdeblur.simulation.scene import scene


@pytest.fixture(scope="module")
def burst(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with two frames of one scene and their recording."""
    folder = tmp_path_factory.mktemp("burst")
    log, camera = hand_shake(0.5, seed=4), Camera(112, 96, 130.0, readout_time=0.02)
    exposures = [Exposure(0.1, 1 / 20), Exposure(0.2, 1 / 20)]
    for n, frame in enumerate(simulate_clip(scene(128, 144), log, camera, exposures, noise=0.005, transfer="srgb")):
        write_picture(folder / f"{n}.png", frame)
    camera.save(folder / "camera.toml")
    rows = "\n".join(f"{int(t * 1e9)},{x},{y},{z}" for t, (x, y, z) in zip(log.t, log.omega, strict=True))
    (folder / "gyro.csv").write_text(f"{rows}\n")
    header = "Timestamp[nanosec],fx[px],Exposure time[nanosec]"
    (folder / "frames.csv").write_text(f"{header}\n100000000,130,50000000\n200000000,130,50000000\n")
    return folder


def arguments(folder: Path, *more: object) -> list[object]:
    recording = ["--gyro", folder / "gyro.csv", "--camera", folder / "camera.toml", "--capture", folder / "frames.csv"]
    return ["burst", folder / "0.png", folder / "1.png", *recording, "--prior", "wiener", *more]


def test_photos_with_json(run, burst: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    result = run(*arguments(burst, "--frames", "0:2", "--reference", 1, "-o", out, "--json"))
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["reference"] == 1
    assert [frame["frame"] for frame in facts["frames"]] == [0, 1]
    assert sum(frame["share"] for frame in facts["frames"]) == pytest.approx(1)
    assert read_picture(out).pixels.shape == (96, 112, 3)
    result = run(*arguments(burst, "--frames", "0,1"))
    assert f"{burst / '0-burst.png'}: 2 of 2 frames" in result.stdout


def test_options_of_deblur_work_for_bursts(run, burst: Path, tmp_path: Path) -> None:
    options = ["--refine", "--border", "periodic", "--saturation", "always", "--softness", "0.3"]
    call = arguments(burst, "--frames", "0:2", "-o", tmp_path / "out.png", "--force", *options)
    result = run(*call, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["refinement"]["accepted"] is False


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        ([], 2, "Missing option '--frames'"),
        (["--frames", "0,1,2"], 2, "names 3 exposures for 2 photos"),
        (["--frames", "0,7"], 1, "there is no exposure 7; the file contains 2"),
        (["--frames", "1:0"], 2, "is not right; write a list of numbers"),
        (["--frames", "1,1"], 2, "each frame once"),
        (["--frames", "0:2", "--reference", "5"], 2, "is not one of --frames"),
        (["--frames", "0:2", "--from", "clip.mp4"], 2, "either photos or --from"),
        (["--frames", "0:2", "--start", "1"], 2, "--start is one moment, but each photo has its own"),
    ],
)
def test_refusals(run, burst: Path, tmp_path: Path, more: list[str], code: int, message: str) -> None:
    result = run(*arguments(burst, *more, "-o", tmp_path / "out.png"))
    assert result.exit_code == code
    assert message in " ".join(result.output.split())
    assert np.array_equal(list(tmp_path.iterdir()), [])


def test_the_frame_that_does_not_fit_is_named(run, burst: Path, tmp_path: Path) -> None:
    with Image.open(burst / "1.png") as picture:
        picture.resize((90, 80)).save(tmp_path / "small.png")
        picture.convert("L").save(tmp_path / "grey.png")
    for name, problem in (("small.png", "frame 1: the picture is 90x80 px"), ("grey.png", "frame 1 has shape")):
        odd = tmp_path / name
        call = [*arguments(burst, "--frames", "0,1", "-o", tmp_path / "out.png")]
        call[2] = odd
        result = run(*call)
        assert result.exit_code == 1
        assert problem in result.stderr
        assert not (tmp_path / "out.png").exists()
