"""The test picture is deterministic, of any size, and has structure at all scales."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.errors import InputError
from rsdeblur.simulation.scene import scene


@pytest.mark.parametrize("shape", [(64, 64), (67, 150), (140, 80)])
def test_any_size_in_range(shape: tuple[int, int]) -> None:
    picture = scene(*shape)
    assert picture.shape == (*shape, 3)
    assert picture.dtype == np.float32
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0


def test_structure_at_all_scales() -> None:
    grey = scene(192, 256).mean(axis=2)
    spectrum = np.abs(np.fft.fft2(grey - grey.mean()))
    radius = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(192)))
    # Amplitudes of photographs fall about as 1/f; a factor of 10 per octave would mean an empty band.
    octaves = [spectrum[(radius > r) & (radius <= 2 * r)].mean() for r in (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)]
    ratios = np.array(octaves[:-1]) / np.array(octaves[1:])
    assert np.all((ratios > 0.8) & (ratios < 5.0)), ratios


@pytest.mark.parametrize("shape", [(63, 100), (100, 10), (100.5, 100)])
def test_refuses_impossible_sizes(shape: tuple[int, int]) -> None:
    with pytest.raises(InputError):
        scene(*shape)
