"""Laws of the transforms."""

import numpy as np
import pytest

from rsdeblur.deconv import fft


@pytest.mark.parametrize("n", [2, 29, 30])
def test_rows_are_numpys_transform_and_come_back(n):
    rng = np.random.default_rng(0)
    rows = fft.RowTransform((2, 3, n))
    values = rng.random((2, 3, n)).astype(np.float32)
    rows.real[...] = values
    rows.forward()
    # 30 values of order 1 are summed in float32.
    np.testing.assert_allclose(rows.spectra, np.fft.rfft(values), atol=1e-5)
    rows.inverse()
    np.testing.assert_allclose(rows.real / n, values, atol=1e-6)
