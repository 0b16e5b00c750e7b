"""The lowest frequencies of a spectrum."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.otf import lowest_frequencies


def test_the_lowest_frequencies_interpolate() -> None:
    # A signal with few frequencies, sampled more finely, has the same spectrum there.
    turns = np.arange(12) / 12
    fine = (3 + np.cos(2 * np.pi * turns) - np.sin(6 * np.pi * turns)).astype(np.complex64)
    out = np.empty((1, 8), np.complex64)
    lowest_frequencies(np.fft.fft(fine).astype(np.complex64)[None], np.full(8, 8 / 12, np.float32), out)
    turns = np.arange(8) / 8
    expected = np.fft.fft(3 + np.cos(2 * np.pi * turns) - np.sin(6 * np.pi * turns))
    # Rounding in float32 of sums of up to 24.
    np.testing.assert_allclose(out[0], expected, atol=1e-5)
