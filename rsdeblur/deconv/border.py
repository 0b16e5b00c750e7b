"""Borders: how tiles continue beyond the picture, and how the two ends of a tile meet.

A discrete Fourier transform repeats its input, so a step from the last row to the first would ring through the result.
As in Sindelar and Sroubek (2013), opposite ends are blended over the PSF's width. The picture itself does not change:
it is continued by reflection, and only the continuation fades from one end into the other. `rsdeblur.kernels.lines`
does this while it moves data.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fade(n: int) -> NDArray[np.float32]:
    """Return a smooth ramp of `n` values strictly between 0 and 1.

    At the end of a tile it is the weight of the pixels that precede the tile.
    """
    ramp: NDArray[np.float32] = (0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))).astype(np.float32)
    return ramp
