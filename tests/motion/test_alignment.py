"""Frames of a burst referred to one of them."""

import numpy as np
import pytest
from scipy.interpolate import interp1d

from rsdeblur import Camera, Exposure, GyroLog, hand_shake
from rsdeblur.choices import Motion
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.motion.alignment import Alignment, burst_captures

CAMERA = Camera(160, 120, 180.0, readout_time=0.03)
EXPOSURES = [Exposure(0.1, 0.05), Exposure(0.25, 0.02), Exposure(-0.6, 0.1, 1_000_000_000)]
ROWS, COLS = np.array([10.0, 60.0, 110.0]), np.array([20.0, 140.0])
LOG = hand_shake(0.6, seed=2)


@pytest.mark.parametrize("motion", ["rotation", "small-angle"])
def test_the_reference_keeps_its_own_paths(motion: Motion) -> None:
    capture = burst_captures(LOG, CAMERA, EXPOSURES, motion=motion)[0]
    alone = BlurPaths.from_capture(Capture.from_log(LOG, CAMERA, EXPOSURES[0], motion=motion), ROWS, COLS, samples=33)
    paths = Alignment(capture, capture)._displacements(ROWS, COLS, 33)
    # The same steps in another order of products.
    np.testing.assert_allclose(paths, alone.displacements, atol=1e-9)


def test_places_lead_there_and_back_and_agree_with_rays() -> None:
    first, _, last = burst_captures(LOG, CAMERA, EXPOSURES)
    points = np.stack(np.meshgrid(COLS, ROWS), axis=-1)
    places = Alignment(last, first).places(points)
    assert np.abs(places - points).max() > 2
    np.testing.assert_allclose(Alignment(first, last).places(places), points, atol=1e-4)
    here, there = (
        np.einsum("...ji,...j->...i", capture.track.at(capture.mid(pixels[..., 1])), CAMERA.rays(pixels))
        for capture, pixels in ((first, points), (last, places))
    )
    np.testing.assert_allclose(np.cross(here, there), 0, atol=1e-6)


def test_paths_of_resampled_frames_start_and_end_around_their_middle() -> None:
    first, second, _ = burst_captures(LOG, CAMERA, EXPOSURES)
    paths = Alignment(second, first)._displacements(ROWS, COLS, 65)
    # At mid-exposure the resampled pixel shows its own place, whatever the rotation between the frames.
    np.testing.assert_allclose(paths[:, :, 32], 0, atol=1e-3)
    own = BlurPaths.from_capture(second, ROWS, COLS)
    assert Alignment(second, first).paths(ROWS, COLS).extent[1] < 1.5 * own.extent[1] + 0.5


def test_rows_between_traced_ones_have_the_paths_that_tracing_gives() -> None:
    first, second, _ = burst_captures(LOG, CAMERA, EXPOSURES)
    alignment = Alignment(second, first)
    got = alignment.every_row(30, 71, COLS)
    expected = alignment.paths(np.arange(30.0, 71.0), COLS)
    np.testing.assert_array_equal(got.rows, expected.rows)
    # They have fewer points, evenly spaced in time.
    fine, coarse = (np.linspace(0, 1, paths.displacements.shape[2]) for paths in (expected, got))
    at_same_times = interp1d(fine, expected.displacements, axis=2)(coarse)
    # Each row takes 0.25 ms to read.
    np.testing.assert_allclose(got.displacements, at_same_times, atol=0.01)
    single = alignment.every_row(30, 31, COLS)
    np.testing.assert_array_equal(single.displacements[0], alignment.every_row(30, 31 + 4, COLS).displacements[0])


def test_a_recording_may_have_more_samples_than_an_exposure() -> None:
    """Frames of a fast gyro are taken one by one; the time between them does not count."""
    t = np.arange(0, 2.2, 1 / 8000)
    log = GyroLog(t, np.full((len(t), 3), 0.02))
    exposures = [Exposure(0.05 + 0.5 * n, 0.01) for n in range(5)]
    for capture, exposure in zip(burst_captures(log, CAMERA, exposures), exposures, strict=True):
        alone = Capture.from_log(log, CAMERA, exposure)
        np.testing.assert_allclose(capture.probe.displacements, alone.probe.displacements, atol=1e-9)
