"""The clock offset from one picture: known offsets of simulated captures, and motions that do not determine it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, InputError, simulate
from rsdeblur.estimate.rival_axes import OTHER_AXES
from rsdeblur.estimate.time_offset import find_time_offset
from rsdeblur.image.transfer import to_linear
from rsdeblur.io import read_camera, read_captures, read_gyro, read_picture
from rsdeblur.io.cameras import write_time_offset
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

ROOT = Path(__file__).resolve().parents[2]
CAMERA, SMALL = (Camera(*size, 500.0, readout_time=0.03) for size in ((448, 320), (320, 224)))
EXPOSURE = Exposure(0.5, 1 / 25)


@pytest.fixture(scope="module")
def sharp():
    return scene(336, 464)


@pytest.fixture(scope="module")
def capture(sharp):
    log = hand_shake(1.0, seed=2)
    return simulate(sharp, log, CAMERA, EXPOSURE, noise=0.005).blurred, log


def test_known_offsets_are_found(data_dir):
    """Photographs, whose spectra are as natural as the model expects; blurs of 10 px and more."""
    errors = []
    cases = (("kodim01", 0, 0.5, -0.05, 0.06), ("kodim05", 1, 0.2, -0.013, 0.03), ("kodim23", 3, 0.6, 0.05, 0.06))
    for name, seed, start, offset, reach in cases:
        sharp = to_linear(read_picture(data_dir / "sharp" / f"{name}.png").pixels[90:330, 150:486] / 255, "srgb")
        log, exposure = hand_shake(1.0, seed=seed), Exposure(start, 1 / 25)
        picture = simulate(sharp, log, SMALL, exposure, noise=0.01).blurred
        search = find_time_offset(picture, log.shifted(-offset), SMALL, exposure, search=(-reach, reach))
        assert search.time_offset is not None
        assert search.scores.min() == 0
        errors.append(abs(search.time_offset - offset))
    # Requirement: 2 ms.
    assert np.median(errors) < 2e-3
    # Well below a tenth of the tremor's period of 0.1 s, where the rates are different.
    assert max(errors) < 5e-3


def test_offsets_count_from_the_camera(capture):
    picture, log = capture
    late = replace(CAMERA, time_offset=3e-3)
    near, far = (find_time_offset(picture, log, camera, EXPOSURE, search=(-0.02, 0.02)) for camera in (CAMERA, late))
    # Their candidates differ; each answer may be wrong by 2 ms, the requirement.
    assert far.best == pytest.approx(near.best, abs=2e-3)


def test_several_photos_share_an_offset(sharp):
    log, camera, search = hand_shake(1.0, seed=2), Camera(224, 160, 500.0, readout_time=0.03), (-0.016, 0.016)
    exposures = [EXPOSURE, Exposure(0.3, 1 / 25)]
    pictures = [simulate(sharp[:176, :240], log, camera, each, noise=0.005).blurred for each in exposures]
    found = find_time_offset(pictures, log, camera, exposures, search=search)
    # As for one picture: the requirement is 2 ms.
    assert found.best == pytest.approx(0.0, abs=2e-3)
    with pytest.raises(InputError, match="one exposure for each image"):
        find_time_offset(pictures, log, camera, exposures[:1])


def test_constant_rates_give_no_answer(sharp):
    log = GyroLog(np.arange(0, 1.0, 0.005), np.tile([0.3, 0.9, 0.1], (200, 1)))
    picture = simulate(sharp[:240, :336], log, SMALL, EXPOSURE, noise=0.005).blurred
    search = find_time_offset(picture, log, SMALL, EXPOSURE)
    assert search.time_offset is None
    assert search.reason


@pytest.mark.parametrize(
    ("seed", "axes"),
    [
        (1, [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
        (2, [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        (2, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    ],
    ids=["exchanged", "a quarter turn", "a quarter turn back"],
)
def test_wrong_axes_give_no_answer(sharp, seed, axes):
    """The picture becomes sharper with an offset, but the right axes explain it better."""
    log = hand_shake(1.0, seed=seed, strength=0.7)
    picture = simulate(sharp[:240, :336], log, SMALL, EXPOSURE, noise=0.005).blurred
    wrong = replace(SMALL, imu_to_camera=axes)
    found = find_time_offset(picture, log.shifted(-0.02), wrong, EXPOSURE, search=(-0.04, 0.03))
    assert found.time_offset is None
    assert found.reason


def test_half_a_turn_gives_no_answer(sharp):
    """Its spectra are those of the right axes; the sharp picture is not."""
    log = hand_shake(1.0, seed=2, strength=0.7)
    picture = simulate(sharp[:240, :336], log, SMALL, EXPOSURE, noise=0.005).blurred
    for turn, expected in ((np.eye(3), ""), (np.diag([-1.0, -1.0, 1.0]), OTHER_AXES)):
        turned = replace(SMALL, imu_to_camera=turn)
        assert find_time_offset(picture, log, turned, EXPOSURE, search=(-0.04, 0.03)).reason == expected


def test_stillness_gives_no_answer(sharp):
    log = hand_shake(1.0, strength=0.0)
    picture = simulate(sharp[:240, :336], log, SMALL, EXPOSURE, noise=0.005).blurred
    assert find_time_offset(picture, log, SMALL, EXPOSURE).time_offset is None


def test_a_turned_capture_gives_the_same_answer(capture):
    picture, log = capture
    upright = find_time_offset(picture, log, CAMERA, EXPOSURE, search=(-0.02, 0.02))
    turned = find_time_offset(np.rot90(picture, -1), log, CAMERA.turned(), EXPOSURE, search=(-0.02, 0.02))
    # Differences are taken towards another side, so tiles lie half a pixel apart.
    assert turned.best == pytest.approx(upright.best, abs=3e-4)


def test_a_log_that_begins_beside_the_exposure_is_searched_as_far_as_it_goes(sharp):
    """Corrections of the last candidates lead out of the log."""
    log, exposure = hand_shake(0.4, seed=3, strength=0.7), Exposure(0.03, 1 / 25)
    picture = simulate(sharp[:240, :336], log, SMALL, exposure, noise=0.005).blurred
    search = find_time_offset(picture, log, SMALL, exposure, search=(-0.05, 0.05))
    assert np.isfinite(search.best)
    # A gyro clock that is later than the camera's by more has no samples there.
    assert search.offsets.max() <= exposure.start


@pytest.mark.parametrize("search", [(0.0, 0.001), (0.1, -0.1), (np.nan, 1.0)])
def test_impossible_searches_are_refused(search):
    with pytest.raises(InputError, match="search"):
        find_time_offset(np.zeros((224, 320)), hand_shake(1.0), CAMERA, EXPOSURE, search=search)


def test_small_pictures_are_refused():
    with pytest.raises(InputError, match="64 px"):
        find_time_offset(np.zeros((60, 60)), hand_shake(1.0), Camera(60, 60, 100.0), EXPOSURE)


def test_real_recordings(data_dir):
    folder = data_dir / "real" / "mars-phone-240ms"
    log, camera = read_gyro(folder / "gyro_accel.csv"), read_camera(ROOT / "docs" / "cameras" / "mars-phone-240ms.toml")
    for index in (2, 5):
        exposure = read_captures(folder / "movie_metadata.csv")[index]
        picture = read_picture(folder / f"frame{index}.jpg").pixels
        search = find_time_offset(picture, log, camera, exposure, transfer="srgb")
        # Known to be the same clock within 5 ms. The hand moved as well, which looks like 20 to 50 ms: no answer is
        # right, another one is not.
        assert search.time_offset is None or abs(search.time_offset) < 8e-3
    folder = data_dir / "real" / "shield-burst"
    picture, log = read_picture(folder / "images" / "0004.jpg").pixels, read_gyro(folder / "imu.txt")
    exposure = read_captures(folder / "images" / "images.txt")[3]
    camera = read_camera(ROOT / "docs" / "cameras" / "shield-burst.toml")
    # In a steady pan every moment has the same blur.
    assert find_time_offset(picture, log, camera, exposure, transfer="srgb").time_offset is None


@pytest.mark.parametrize("line", ["", "time_offset = 0.5 # guessed\n"])
def test_the_camera_file_keeps_its_other_lines(tmp_path, line):
    file = tmp_path / "camera.toml"
    file.write_text(f"# mine\nwidth = 64\nheight = 48\n{line}focal_length = 70.0")
    write_time_offset(file, -1.25e-3)
    assert read_camera(file).time_offset == -1.25e-3
    text = file.read_text()
    assert text.startswith("# mine\nwidth = 64\nheight = 48\n")
    assert ("# guessed" in text) is bool(line)
