"""Matches of all neighbouring frames of a clip: corners followed by the pyramidal method of Lucas and Kanade.

The method minimises the squared difference of small windows, so it also works in blurred frames: a blurred point is
found at the centroid of its path. Frames are reduced first, which averages noise and shortens blur.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from skimage.feature import corner_shi_tomasi
from skimage.filters import window
from skimage.registration import phase_cross_correlation
from skimage.transform import downscale_local_mean

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import EncodedImage, check_size
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.types import Float32Array, FloatArray, Progress

# Frames further apart than this are not matched, s. With fewer matches, a pair of frames does not count.
LONGEST_STEP, LEAST_MATCHES = 0.6, 12
# Half side of a window, px: wide enough to see two directions in blurred frames.
RADIUS = 10
# The best corner of each cell is followed if it is this share of the typical one.
LEAST_CORNER = 0.05
# Largest distance, px of the reduced frame, by which a point followed there and back may miss its origin.
RETURN = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ClipMatches:
    """Matches of all pairs of neighbouring frames of a clip."""

    points: FloatArray  # (n, 2), (x, y) in px in the first frame of the pair
    moved: FloatArray  # (n, 2), the same in the second frame
    pair: NDArray[np.intp]  # (n,), number of the pair, not decreasing
    # (pairs, 2), start of the middle row's exposure if the shutter were global, s, camera time without offset
    opens: FloatArray
    durations: FloatArray  # (pairs, 2), exposure times of a row, s

    def thinned(self, count: int) -> ClipMatches:
        """Return about `count` matches of each pair, with the same numbers of the pairs."""
        step = max(1, round(len(self.pair) / len(self.opens) / count))
        return replace(self, points=self.points[::step], moved=self.moved[::step], pair=self.pair[::step])

    def sums(self, values: FloatArray) -> FloatArray:
        """Return sums over the matches of each pair of values, shape (n, ...); shape (pairs, ...)."""
        count = len(self.pair)
        ones = sparse.csr_array((np.ones(count), (self.pair, np.arange(count))), shape=(len(self.opens), count))
        summed: FloatArray = np.asarray(ones @ values.reshape(count, -1))
        return summed.reshape(-1, *values.shape[1:])


class ReducedFrame:
    """A frame, brightness of any scale (H, W), reduced by a whole factor, with its pyramid."""

    def __init__(self, grey: NDArray[np.floating]) -> None:
        self.factor = max(1, round(max(grey.shape) / 640))  # whole, to about 640 px
        height, width = (side - side % self.factor for side in grey.shape)
        reduced = downscale_local_mean(grey[:height, :width], self.factor).astype(np.float32)
        self.levels: list[Float32Array] = [ndimage.gaussian_filter(reduced, 1.0)]
        # The coarsest level keeps two windows along its shorter side.
        while min(self.levels[-1].shape) >= 8 * RADIUS:
            self.levels.append(ndimage.gaussian_filter(self.levels[-1], 1.0)[::2, ::2])

    def corners(self) -> FloatArray:
        """Return the best corner of each cell, shape (n, 2), (x, y) in px of the reduced frame."""
        strength = corner_shi_tomasi(self.levels[0], sigma=RADIUS / 3)[RADIUS:-RADIUS, RADIUS:-RADIUS]
        # The longer side has 11 cells.
        rows, cols = np.indices(strength.shape) // max(RADIUS, -(-max(strength.shape) // 11))
        cells = rows * (1 + cols.max()) + cols
        places = np.array(ndimage.maximum_position(strength, cells, np.unique(cells)))
        best = strength[tuple(places.T)]
        values: FloatArray = places[best > LEAST_CORNER * np.median(best)][:, ::-1] + float(RADIUS)
        return values

    def full(self, points: FloatArray) -> FloatArray:
        """Return points of the reduced frame in px of the frame as stored."""
        values: FloatArray = points * self.factor + (self.factor - 1) / 2
        return values


def match(first: ReducedFrame, second: ReducedFrame) -> tuple[FloatArray, FloatArray]:
    """Return points of a frame, found there and back, and where the next one shows them, (x, y) in px as stored."""
    points = first.corners()
    moved = _follow(first, second, points, points + _common_shift(first, second))
    # The way back begins nearly right.
    back = _follow(second, first, moved, points, levels=2)
    height, width = first.levels[0].shape
    inside = ((moved >= 0) & (moved <= (width - 1, height - 1))).all(axis=1)
    good = inside & (np.linalg.norm(back - points, axis=1) < RETURN)
    return first.full(points[good]), second.full(moved[good])


def _common_shift(first: ReducedFrame, second: ReducedFrame) -> FloatArray:
    """Return the shift (x, y) in px of the reduced frames that aligns the coarsest level but one by its phases."""
    level = max(len(first.levels) - 2, 0)
    pictures = [frame.levels[level] for frame in (first, second)]
    if not all(np.ptp(picture) for picture in pictures):
        return np.zeros(2)
    # A window takes away the jump between opposite borders, which would say "no motion".
    fade = window("hann", pictures[0].shape)
    shift, *_ = phase_cross_correlation(*((picture - picture.mean()) * fade for picture in pictures))
    return -np.array(shift[::-1], dtype=np.float64) * 2.0**level


def _follow(
    first: ReducedFrame, second: ReducedFrame, points: FloatArray, guess: FloatArray, *, levels: int | None = None
) -> FloatArray:
    """Return where `second` shows the points of `first`, starting from a guess at one of the finest `levels`."""
    # Every second pixel of a window is compared.
    grid = np.arange(-RADIUS, RADIUS + 1, 2)
    around = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    moved: FloatArray = guess
    for level in reversed(range(len(first.levels))[:levels]):
        here, there, scale = first.levels[level], second.levels[level], 2.0**level
        places = points[:, None] / scale + around
        patch = _sample(here, places)
        slopes = np.stack([_sample(slope, places) for slope in np.gradient(here)[::-1]], axis=-1)
        normal = np.einsum("nwi,nwj->nij", slopes, slopes)
        # A little of the trace keeps windows with one direction solvable.
        normal += (1e-3 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(2)
        inverse = np.linalg.inv(normal)
        for _ in range(5):
            difference = patch - _sample(there, moved[:, None] / scale + around)
            gradient = np.einsum("nwi,nw->ni", slopes, difference)
            moved = moved + scale * np.einsum("nij,nj->ni", inverse, gradient).clip(-RADIUS, RADIUS)
    return moved


def _sample(picture: Float32Array, places: FloatArray) -> Float32Array:
    """Return values at (x, y), interpolated linearly, without their mean in each window."""
    at = np.moveaxis(places[..., ::-1], -1, 0)
    values = ndimage.map_coordinates(picture, at, order=1, mode="nearest", output=np.float32)
    array: Float32Array = values - values.mean(axis=-1, keepdims=True)
    return array


def match_clip(
    frames: Iterable[ArrayLike], exposures: Sequence[Exposure], camera: Camera, progress: Progress | None = None
) -> ClipMatches:
    """Return the matches of neighbouring frames, with times from the first exposure's epoch; see :func:`calibrate`."""
    share = TIMESTAMP_SHARES[camera.timestamp_marks]
    # The empty arrays make the shapes right where there are no pairs.
    found, opens, durations = [(np.empty((0, 2)), np.empty((0, 2)))], [], []
    before: ReducedFrame | None = None
    start = -np.inf
    for count, (image, exposure) in enumerate(zip_longest(validate.items("frames", frames), exposures)):
        if image is None or exposure is None:
            given = count if image is None else f"more than {count}"
            raise InputError(f"give one exposure for each frame, got {given} frames and {len(exposures)} exposures")
        now = ReducedFrame(_grey(image, camera))
        end = 1e-9 * (exposure.epoch_ns - exposures[0].epoch_ns) + exposure.start - share * exposure.duration
        if end <= start:
            raise InputError(f"the exposures must be in the order of time: frame {count} is not after the one before")
        if before is not None and end - start < LONGEST_STEP:
            points, moved = match(before, now)
            # Of directions that the lens model describes, in front of the camera.
            good = np.all([camera.rays(each)[:, 2] > 0 for each in (points, moved)], axis=0)
            if good.sum() >= LEAST_MATCHES:
                found.append((points[good], moved[good]))
                opens.append((start, end))
                durations.append((exposures[count - 1].duration, exposure.duration))
        before, start = now, end
        if progress:
            progress("match", (count + 1) / len(exposures))
    numbers = np.repeat(np.arange(len(opens)), [len(points) for points, _ in found[1:]])
    points, moved = (np.concatenate(each) for each in zip(*found, strict=True))
    return ClipMatches(points, moved, numbers, np.reshape(opens, (-1, 2)), np.reshape(durations, (-1, 2)))


def _grey(image: ArrayLike, camera: Camera) -> NDArray[np.float32]:
    """Return the brightness of a frame as its values encode it; shadows have more contrast there than in light."""
    encoded = EncodedImage.of(image)
    check_size(encoded.shape, camera)
    grey: NDArray[np.float32] = encoded.values[..., : encoded.shape[2]].mean(axis=2, dtype=np.float32)
    if not np.isfinite(grey).all():
        raise InputError("a frame must be finite")
    return grey
