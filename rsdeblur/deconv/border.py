"""What a tile sees where the picture ends, and how its two ends are made to meet.

A discrete Fourier transform repeats its input; a step from the last row to the first would ring through the result.
As in Sindelar and Sroubek (2013), opposite ends are blended over the PSF's width. The picture itself is left alone: it
is continued by reflection, and only the continuation fades from one end into the other. The work is done while data are
moved, in `rsdeblur.kernels.lines`.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Border = Literal["blend", "periodic"]
BORDERS: tuple[Border, ...] = ("blend", "periodic")
# Alternatives, made before a periodic solve (`rsdeblur.deconv.boundary`).
Boundary = Literal["reflect", "edge-taper", "smooth"]
BOUNDARIES: tuple[Boundary, ...] = ("reflect", "edge-taper", "smooth")


def split(border: Border | Boundary) -> tuple[Border, Boundary | None]:
    """Return the border of the solver, and the boundary that makes the picture periodic first, if any."""
    if border == "blend" or border == "periodic":
        return border, None
    return "periodic", border


def fade(n: int) -> NDArray[np.float32]:
    """Return a smooth ramp of `n` values strictly between 0 and 1: the share of what precedes a tile in its end."""
    ramp: NDArray[np.float32] = (0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))).astype(np.float32)
    return ramp
