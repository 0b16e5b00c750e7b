"""Laws of the transforms."""

import numpy as np
import pytest

from rsdeblur.choices import PLANNINGS
from rsdeblur.deconv import fft


@pytest.mark.parametrize("planning", PLANNINGS)
@pytest.mark.parametrize("n", [2, 29, 30])
def test_rows_are_numpys_transform_and_come_back(planning, n):
    rng = np.random.default_rng(0)
    rows = fft.RowTransform((2, 3, n), planning)
    values = rng.random((2, 3, n)).astype(np.float32)
    rows.real[...] = values
    rows.forward()
    # 30 values of order 1 are summed in float32.
    np.testing.assert_allclose(rows.spectra, np.fft.rfft(values), atol=1e-5)
    rows.inverse()
    np.testing.assert_allclose(rows.real / n, values, atol=1e-6)


@pytest.mark.parametrize("length", [210, 360])
def test_what_was_measured_changes_no_estimated_transform(length):
    """The same bits before and after plans were measured."""
    rng = np.random.default_rng(length)
    values = rng.standard_normal((4, length)) + 1j * rng.standard_normal((4, length))

    def transformed(planning="estimate"):
        lines = fft.LineTransform((4, length), planning)
        lines.lines[...] = values
        lines.forward()
        return lines.spectra

    alone = transformed()
    # Measured plans may or may not give other bits.
    transformed("measure")
    np.testing.assert_array_equal(transformed(), alone)
