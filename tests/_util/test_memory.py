"""Arrays are aligned for SIMD."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur._util.memory import ALIGNMENT, empty


@pytest.mark.parametrize("shape", [(), (3, 5), (700, 600)])
def test_arrays_are_aligned_and_writable(shape):
    for dtype in (np.float32, np.complex64, np.uint8):
        array = empty(shape, dtype)
        assert array.ctypes.data % ALIGNMENT == 0
        array[...] = 3
        assert (array.shape, array.dtype, array.flags.c_contiguous) == (shape, dtype, True)
