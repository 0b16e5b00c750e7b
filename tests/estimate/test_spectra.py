"""Spectra of tiles: the noise that is not taken for a scene."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur.estimate.periodograms import TILE
from rsdeblur.estimate.spectra import TilePeriodograms
from rsdeblur.psf import PsfBank
from rsdeblur.types import Float32Array

PLACES = np.arange(0, 5 * TILE, TILE)


def noise(softness: float) -> Float32Array:
    """Return noise without a scene, smoothed as by denoising."""
    white = np.random.default_rng(1).standard_normal((5 * TILE, 5 * TILE), dtype=np.float32)
    return np.asarray(0.01 * ndimage.gaussian_filter(white, softness, mode="wrap"), np.float32)


def test_white_noise_is_found_white() -> None:
    measured, white = (TilePeriodograms(noise(0.0), PLACES, PLACES, white=white) for white in (False, True))
    # The least of 8 directions, in a quiet tenth of the tiles, is no more than the mean.
    np.testing.assert_array_equal(measured.noise, white.noise)


@pytest.mark.parametrize("softness", [0.7, 1.0])
def test_noise_without_a_scene_proves_no_motion(softness: float) -> None:
    """Smoothed noise is alike in all directions. White noise does not explain it, so a long blur seems unlikely."""
    blurs = [PsfBank.for_picture(np.full(shape, 1 / 9), (TILE, TILE)).kernels for shape in ((1, 9), (3, 3))]
    leads = []
    for white in (True, False):
        measured = TilePeriodograms(noise(softness), PLACES, PLACES, white=white)
        place = np.zeros(len(measured.power), np.intp)
        straight, even = (measured.fit(measured.expected(blur), place)[0] for blur in blurs)
        leads.append(np.abs(straight - even).mean())
    # Measured: 20 of 96 and 21 of 300 nats. White noise would leave all of them.
    assert leads[1] < 0.3 * leads[0]
