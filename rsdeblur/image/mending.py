"""Mending of a result in linear light: below black, which no scene has, and beside what the sensor clipped.

Where things move otherwise than the motion says, because they are near or move themselves, the solve leaves waves
beside their edges. In dark surroundings the waves fall below zero, and a file would store them as black stripes. How
far they fall, compared with the light that was recorded there, shows how unreliable the result is there: it fades
towards the blurred picture. The right motion leaves hardly any such light, so it changes hardly anything.

A clipped pixel recorded less than the light that reached it, and each channel clips elsewhere. The solve takes the cut
for an edge of the scene, another one in each channel, and leaves dark and coloured lines beside it. The colours that
the photo itself has there limit those of the result. Its darkness limits that of the result loosely, because blur
lowers the contrast of small things, such as letters on white paper.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.threads import share, share_blocks, share_map
from rsdeblur.image.encoded import ROWS, EncodedImage
from rsdeblur.image.highlights import full_scale
from rsdeblur.kernels.mend import Between, depths, extremes, fade_to, limit
from rsdeblur.types import Float32Array, FloatArray, FloatImage

# Standard deviation of the Gaussian that the weight of the blurred picture is smooth by, in lengths of the PSF, and at
# least in px: the waves of a wrong motion are some tenths of the PSF wide.
SPREAD, LEAST_SPREAD = 0.15, 1.5
# Light below black, as a share of the recorded light, from which only the blurred picture is left; the share of the
# picture's bright parts that is added to the recorded light, so that noise in black places is no evidence; and the
# weight that counts as 0.
MOST, DARK, LEAST = 1 / 8, 0.01, 0.02
# Equal parts of the picture along the readout that are measured by themselves.
PARTS = 6
# Side of the window around a pixel that the photo's range is taken over, in lengths of the PSF: light of the pixel went
# half a PSF far, and as far again reaches what came from there.
WINDOW = 1.5
# By how much a result may leave the range of the photo: as a share of the range, below its luma and beyond its
# chroma, and at least, as the square root of light. (docs/developer/decisions.md)
DARKER, MORE_COLOURED, LEAST_BEYOND = 1.0, 0.1, 1 / 255
# Luma, as the square root of light, from which a cell is white: 250 of 255 in sRGB, for JPEG's sake.
WHITE = 0.978
# Cells in the length of a PSF, the least size of a cell in px, and the number of cells over which the limits set in.
CELLS, LEAST_CELL, FADE = 8, 8, 3


def fade_undershoot(
    sharp: FloatImage,
    encoded: EncodedImage,
    first: int,
    size: tuple[int, int],
    peak: float = 1.0,
    *,
    threads: int | None = None,
) -> None:
    """Fade a result in place, where it contains light below black, towards the blurred picture.

    `sharp` (h, W, C) is linear light, not clipped, from the row `first` of the blurred picture on. `size` is that of
    the largest PSF, px, and `peak` the value of the picture's bright parts.
    """
    spread = max(LEAST_SPREAD, SPREAD * max(size))
    step = max(1, round(spread / 1.5))  # px of a cell, which has one weight
    below = _below_black(sharp, step, threads)
    if not below.any():
        return
    height, width, channels = sharp.shape
    cells = encoded.values[first : first + height : step, ::step, :channels]
    recorded = EncodedImage(cells, encoded.transfer).grey(slice(None))
    near, around = share_map(
        lambda light: ndimage.gaussian_filter(light, spread / step, mode="nearest"), [below, recorded], threads
    )
    peak = max(peak, 1e-9)  # not 0; dark pictures keep theirs, while priors have a larger least peak
    weight = np.clip(near / (MOST * (np.maximum(around, 0.0) + DARK * peak)) - LEAST, 0.0, 1.0)
    down, across = (_between(n, len_cells, step) for n, len_cells in zip((height, width), weight.shape, strict=True))

    def fade_tile(_: int, rows: slice, cols: slice) -> None:
        (above, under, low), (left, right, far) = down, across
        above, under, low, left, right, far = above[rows], under[rows], low[rows], left[cols], right[cols], far[cols]
        if weight[above[0] : under[-1] + 1, left[0] : right[-1] + 1].any():
            values = encoded.values[first + rows.start : first + rows.stop, cols]
            blurred = EncodedImage(values, encoded.transfer).linear(slice(None))
            fade_to(sharp[rows, cols], blurred, weight, (above, under, low), (left, right, far))

    share_blocks(fade_tile, (height, width), (128, 128), threads)


def _between(n: int, cells: int, step: int) -> Between:
    """Return the cells that `n` pixels lie between."""
    place = np.clip((np.arange(n) + 0.5) / step - 0.5, 0.0, cells - 1.0)
    before = np.minimum(place.astype(np.intp), max(cells - 2, 0))
    return before, np.minimum(before + 1, cells - 1), (place - before).astype(np.float32)


def _below_black(sharp: FloatImage, step: int, threads: int | None) -> NDArray[np.float32]:
    """Return the mean depth below zero, of the channel where it is largest, in cells of `step` x `step` px."""
    below = np.empty([-(-n // step) for n in sharp.shape[:2]], dtype=np.float32)
    rows = 16  # of cells, measured at a time

    def measure(_: int, top: int) -> None:
        depths(sharp[top * step : (top + rows) * step], step, below[top : top + rows])

    share(measure, range(0, len(below), rows), threads)
    return below


class UndershootMeter:
    """Measurement, chunk by chunk, of the light below black that deblurring adds to a picture of so many rows."""

    def __init__(self, height: int) -> None:
        # Every eighth row is measured, or at least 64 rows.
        self._step = int(np.clip(height // 64, 1, 8))
        # Not row 0, because the first row of the frame rings more than others.
        self._first = self._step // 2
        self._part = np.arange(self._first, height, self._step) * PARTS // height
        self._rows = np.zeros((4, len(self._part)))

    def before(self, light: NDArray[np.float32], rows: slice) -> None:
        """Measure rows of the input."""
        light, at = self._some(light, rows)
        self._rows[:3, at] = light.mean((1, 2)), np.square(light).mean((1, 2)), _mean_square_below_black(light)

    def after(self, light: NDArray[np.float32], rows: slice) -> None:
        """Measure rows of the result, before they are clipped."""
        light, at = self._some(light, rows)
        self._rows[3, at] = _mean_square_below_black(light)

    def _some(self, light: NDArray[np.float32], rows: slice) -> tuple[NDArray[np.float32], slice]:
        first, stop = (-(-(row - self._first) // self._step) for row in (rows.start, rows.stop))
        return light[first * self._step + self._first - rows.start :: self._step], slice(first, stop)

    def ringing(self) -> tuple[float, tuple[float, ...]]:
        """Return the ringing of the whole picture and of each part."""
        mean, square, before, after = self._rows
        contrast = max(float(square.mean() - mean.mean() ** 2), 1e-12)
        gained = (after - before) / contrast
        parts = [gained[self._part == part] for part in range(PARTS)]
        whole, *each = (np.sqrt(max(float(np.mean(part)), 0.0)) if part.size else 0.0 for part in (gained, *parts))
        return float(whole), tuple(map(float, each))


def _mean_square_below_black(light: NDArray[np.float32]) -> FloatArray:
    means: FloatArray = np.square(np.minimum(light, 0.0)).mean((1, 2))
    return means


def keep_colours_near_clipped(
    sharp: FloatImage,
    encoded: EncodedImage,
    first: int,
    size: tuple[int, int],
    *,
    threads: int | None = None,
) -> None:
    """Limit luma and chroma of a result in place, beside pixels that the blurred picture has at full scale.

    `sharp` (h, W, C) is linear light from the row `first` of the blurred picture on; `size` is that of the largest PSF,
    px.
    """
    height, _, channels = sharp.shape
    values = encoded.values[first : first + height, :, :channels]
    white = full_scale(values)
    # A float picture that exceeds 1 was not clipped there.
    if values.max() < white or (values.dtype.kind != "u" and encoded.values[..., :channels].max() > white):
        return
    step = max(LEAST_CELL, size[0] // CELLS), max(LEAST_CELL, size[1] // CELLS)
    window = tuple(2 * int(np.ceil(WINDOW / 2 * length / cell)) + 1 for length, cell in zip(size, step, strict=True))
    photo = EncodedImage(values, encoded.transfer)
    clipped = _clipped(photo, white, step, threads)
    near = ndimage.uniform_filter(ndimage.maximum_filter(clipped, window, mode="nearest"), FADE, mode="nearest")
    # Limits are interpolated between cells, of which some have no weight.
    needed = ndimage.maximum_filter(near > 0, [n + 2 for n in window], mode="nearest")
    lowest, highest = _extremes(photo, needed, step, threads)
    low = ndimage.minimum_filter(lowest, (*window, 1), mode="nearest")
    high = ndimage.maximum_filter(highest, (*window, 1), mode="nearest")
    luma, chroma = high[..., :1] - low[..., :1], (high - low)[..., 1:].max(axis=2, keepdims=True)
    # Channels share the widest range of the chroma.
    beyond = np.concatenate([DARKER * luma, *[MORE_COLOURED * chroma] * channels], axis=2)
    least, most = low - beyond - np.float32(LEAST_BEYOND), high + beyond + np.float32(LEAST_BEYOND)
    # What is white over a whole PSF was nowhere darker.
    psf = tuple(-(-length // cell) for length, cell in zip(size, step, strict=True))
    whole = ndimage.grey_opening((lowest[..., 0] >= WHITE).view(np.uint8), psf, mode="nearest") > 0
    least[whole, 0] = lowest[whole, 0]
    # Nothing says how bright clipped light was at most.
    most[..., 0] = validate.MOST_LIGHT

    def limit_rows(_: int, top: int) -> None:
        limit(sharp[top : top + ROWS], top, *step, near, least, most)

    share(limit_rows, range(0, height, ROWS), threads)


def _clipped(photo: EncodedImage, white: float, step: tuple[int, int], threads: int | None) -> Float32Array:
    """Return 1 for cells with a clipped pixel, else 0."""
    height, width, channels = photo.shape
    clipped = np.zeros((-(-height // step[0]), -(-width // step[1])), np.float32)

    def find(_: int, n: int) -> None:
        brightest: NDArray[np.generic] = photo.values[n * step[0] : (n + 1) * step[0]].max(axis=0)
        clipped[n, np.flatnonzero(brightest == white) // (step[1] * channels)] = 1

    share(find, range(len(clipped)), threads)
    return clipped


def _extremes(
    photo: EncodedImage, needed: NDArray[np.bool_], step: tuple[int, int], threads: int | None
) -> tuple[Float32Array, Float32Array]:
    """Return the extremes of luma and chroma in the cells that are needed, and 0 in the others."""
    lowest, highest = np.zeros((2, *needed.shape, photo.shape[2] + 1), np.float32)

    def measure(_: int, n: int) -> None:
        rows = photo.values[n * step[0] : (n + 1) * step[0]]
        # Each run of needed cells begins and ends where they change.
        changes = np.flatnonzero(np.diff(needed[n], prepend=False, append=False))
        for first, end in changes.reshape(-1, 2):
            cells = EncodedImage(rows[:, first * step[1] : end * step[1]], photo.transfer).linear(slice(None))
            extremes(np.sqrt(np.maximum(cells, 0)), step[1], lowest[n, first:end], highest[n, first:end])

    share(measure, range(len(needed)), threads)
    return lowest, highest
