"""Floats as whole numbers of files."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def quantised(image: NDArray[Any], bits: int) -> NDArray[Any]:
    """Return values in [0, 1] as samples of `bits` bits; 32 is float32."""
    if image.dtype.kind == "u":
        if 8 * image.dtype.itemsize == bits:
            return image
        image = image / np.float32(np.iinfo(image.dtype).max)
    if bits == 32:
        return image.astype(np.float32)
    # float16 cannot represent 65535.
    clipped: NDArray[Any] = np.clip(image, 0.0, 1.0).astype(np.promote_types(image.dtype, np.float32))
    clipped *= 2**bits - 1
    levels: NDArray[Any] = np.rint(clipped, out=clipped).astype(np.uint8 if bits == 8 else np.uint16)
    return levels
