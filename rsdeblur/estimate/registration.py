"""Matches between two frames of a clip: corners followed by the pyramidal method of Lucas and Kanade.

The method minimises the squared difference of small windows, so it also works in blurred frames: a blurred point is
found at the centroid of its path. Frames are reduced first, which averages noise and shortens blur.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.feature import corner_shi_tomasi
from skimage.registration import phase_cross_correlation

from rsdeblur.types import Float32Array, FloatArray

# Longer side of the reduced frame, px, to within the rounding of a whole factor.
SIDE = 640
# Cells along the longer side of the frame; the best corner of each is followed.
CELLS = 11
# Half side of a window, px: wide enough to see two directions in blurred frames. Every second pixel is compared.
RADIUS, STRIDE = 10, 2
# The coarsest level of the pyramid keeps a shorter side of two windows.
COARSEST = 4 * RADIUS
# Newton steps per level.
STEPS = 5
# Levels of the pyramid on the way back, whose start is nearly right.
BACK = 2
# Smoothing in px before each reduction by 2, and before gradients are taken.
SMOOTHING = 1.0
# Largest distance, px of the reduced frame, by which a point followed there and back may miss its origin.
RETURN = 0.5
# A corner counts if its smaller eigenvalue is this share of the median of all cells' best ones.
LEAST_CORNER = 0.05


class Matches(NamedTuple):
    """Points of one frame and where the next frame shows them.

    Parameters
    ----------
    points, moved : ndarray, shape (n, 2)
        (x, y) in px of the frame as stored.
    """

    points: FloatArray
    moved: FloatArray


class ReducedFrame:
    """A frame reduced by a whole factor, with its pyramid.

    Parameters
    ----------
    grey : ndarray, shape (H, W)
        Brightness, of any scale.
    """

    def __init__(self, grey: NDArray[np.floating]) -> None:
        self.factor = max(1, round(max(grey.shape) / SIDE))
        height, width = (side // self.factor for side in grey.shape)
        cut = grey[: height * self.factor, : width * self.factor].astype(np.float32)
        reduced = cut.reshape(height, self.factor, width, self.factor).mean(axis=(1, 3))
        self.levels = [_smooth(reduced)]
        while min(self.levels[-1].shape) >= 2 * COARSEST:
            self.levels.append(_smooth(self.levels[-1])[::2, ::2])

    def corners(self) -> FloatArray:
        """Return the best corner of each cell, shape (n, 2), (x, y) in px of the reduced frame."""
        strength = corner_shi_tomasi(self.levels[0], sigma=RADIUS / 3)
        margin = RADIUS
        inner = strength[margin:-margin, margin:-margin]
        cell = max(RADIUS, -(-max(inner.shape) // CELLS))
        best, places = [], []
        for top in range(0, inner.shape[0], cell):
            for left in range(0, inner.shape[1], cell):
                part = inner[top : top + cell, left : left + cell]
                y, x = np.unravel_index(part.argmax(), part.shape)
                best.append(part[y, x])
                places.append((left + x + margin, top + y + margin))
        enough = np.array(best) > max(LEAST_CORNER * np.median(best), 0.0)
        chosen: FloatArray = np.array(places, dtype=np.float64)[enough]
        return chosen

    def full(self, points: FloatArray) -> FloatArray:
        """Return points of the reduced frame in px of the frame as stored."""
        full: FloatArray = points * self.factor + (self.factor - 1) / 2
        return full


def _smooth(picture: Float32Array) -> Float32Array:
    smooth: Float32Array = ndimage.gaussian_filter(picture, SMOOTHING)
    return smooth


def match(first: ReducedFrame, second: ReducedFrame) -> Matches:
    """Return the matches of two frames of one size.

    A point counts if following it back from the second frame returns to its origin.

    Parameters
    ----------
    first, second : ReducedFrame
        The frames.

    Returns
    -------
    Matches
        Up to about a hundred.
    """
    points = first.corners()
    shift = _common_shift(first, second)
    moved = _follow(first, second, points, points + shift)
    back = _follow(second, first, moved, points, levels=BACK)
    height, width = first.levels[0].shape
    inside = ((moved >= 0) & (moved <= (width - 1, height - 1))).all(axis=1)
    good = inside & (np.linalg.norm(back - points, axis=1) < RETURN)
    return Matches(first.full(points[good]), second.full(moved[good]))


def _common_shift(first: ReducedFrame, second: ReducedFrame) -> FloatArray:
    """Return the shift (x, y) in px of the reduced frames that aligns the coarsest level but one by its phases."""
    level = max(len(first.levels) - 2, 0)
    pictures = [frame.levels[level] for frame in (first, second)]
    height, width = pictures[0].shape
    if not all(np.ptp(picture) for picture in pictures):
        return np.zeros(2)
    # A window takes away the jump between opposite borders, which would say "no motion".
    window = np.hanning(height)[:, None] * np.hanning(width)
    shift, *_ = phase_cross_correlation(*((p - p.mean()) * window for p in pictures))
    moved: FloatArray = -np.array(shift[::-1], dtype=np.float64) * 2.0**level
    return moved


def _follow(
    first: ReducedFrame, second: ReducedFrame, points: FloatArray, guess: FloatArray, *, levels: int | None = None
) -> FloatArray:
    """Return where `second` shows the points of `first`, starting from a guess at one of the finest `levels`."""
    grid = np.arange(-RADIUS, RADIUS + 1, STRIDE)
    window = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    moved: FloatArray = guess
    for level in reversed(range(len(first.levels))[:levels]):
        scale = 2.0**level
        here, there = first.levels[level], second.levels[level]
        places = points[:, None] / scale + window
        patch = _sample(here, places)
        slopes = np.stack([_sample(slope, places) for slope in np.gradient(here)[::-1]], axis=-1)
        normal = np.einsum("nwi,nwj->nij", slopes, slopes)
        # A little of the trace keeps windows with one direction solvable.
        normal += (1e-3 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(2)
        inverse = np.linalg.inv(normal)
        for _ in range(STEPS):
            difference = patch - _sample(there, moved[:, None] / scale + window)
            gradient = np.einsum("nwi,nw->ni", slopes, difference)
            moved = moved + scale * np.einsum("nij,nj->ni", inverse, gradient).clip(-RADIUS, RADIUS)
    return moved


def _sample(picture: Float32Array, places: FloatArray) -> Float32Array:
    """Return values at (x, y), interpolated linearly, without their mean in each window."""
    at = np.moveaxis(places[..., ::-1], -1, 0)
    values = ndimage.map_coordinates(picture, at, order=1, mode="nearest", output=np.float32)
    centred: Float32Array = values - values.mean(axis=-1, keepdims=True)
    return centred
