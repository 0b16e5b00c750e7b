"""Mending of a result in linear light: below black, which no scene has, and beside what the sensor clipped.

Where things move otherwise than the motion says, the solve leaves waves beside their edges. In dark surroundings these
fall below zero, and a file would store them as black stripes. The farther they fall, compared with the recorded light,
the more the result fades towards the blurred picture there. The right motion leaves hardly any such light.

A clipped pixel recorded less than the light that reached it, and each channel clips elsewhere. The solve takes the cut
for an edge of the scene, and leaves dark and coloured lines beside it. The colours of the photo there limit those of
the result. Its darkness does so loosely, because blur lowers the contrast of small things, such as letters on paper.

These limits hold for square roots of linear light, which are about as even to the eye as encoded values. The *luma* of
a pixel is the mean of its channels there, its *chroma* is what each channel has more than that.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.threads import share, share_blocks, share_map
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.highlights import full_scale
from rsdeblur.types import Float32Array, FloatArray, FloatImage

# Standard deviation of the Gaussian that the weight of the blurred picture is smooth by, in lengths of the PSF, and at
# least in px: the waves of a wrong motion are some tenths of the PSF wide.
SPREAD, LEAST_SPREAD = 0.15, 1.5
# Light below black, as a share of the recorded light, from which only the blurred picture is left; the share of the
# bright parts that is added to the latter, so that noise in black places is no evidence; and the weight that is 0.
MOST, DARK, LEAST = 1 / 8, 0.01, 0.02
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
# Rows and columns that are mended at a time, so that all arrays fit into a second-level cache.
BLOCK = 128, 128

# Indices (n,) of the cells before and after each of n pixels, and how near each is to the latter, from 0 to 1.
Between = tuple[NDArray[np.intp], NDArray[np.intp], Float32Array]


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
    sample = encoded.values[first : first + height : step, ::step, :channels]
    recorded = EncodedImage(sample, encoded.transfer).grey(slice(None))
    near, around = share_map(
        lambda light: ndimage.gaussian_filter(light, spread / step, mode="nearest"), [below, recorded], threads
    )
    peak = max(peak, 1e-9)  # not 0; dark pictures keep theirs, while priors have a larger least peak
    weight: Float32Array = np.clip(near / (MOST * (np.maximum(around, 0.0) + DARK * peak)) - LEAST, 0.0, 1.0)
    down, pixels = (_between(n, cells, step) for n, cells in zip((height, width), weight.shape, strict=True))
    left, right, far = pixels
    across = np.repeat(left, channels), np.repeat(right, channels), np.repeat(far, channels)

    def fade_block(_: int, rows: slice, cols: slice) -> None:
        places = _cut(down, rows), _cut(across, slice(cols.start * channels, cols.stop * channels))
        if _near(weight, *places).any():
            values = encoded.values[first + rows.start : first + rows.stop, cols]
            light, change = sharp[rows, cols], EncodedImage(values, encoded.transfer).linear(slice(None))
            with np.errstate(over="ignore", invalid="ignore"):  # a result that is not finite is refused later
                change -= light
                change *= _interpolated(weight, *places).reshape(change.shape)
                light += change

    share_blocks(fade_block, (height, width), BLOCK, threads)


def _between(n: int, cells: int, step: int) -> Between:
    """Return the cells that `n` pixels lie between."""
    place = np.clip((np.arange(n) + 0.5) / step - 0.5, 0.0, cells - 1.0)
    before = np.minimum(place.astype(np.intp), max(cells - 2, 0))
    return before, np.minimum(before + 1, cells - 1), (place - before).astype(np.float32)


def _cut(places: Between, part: slice) -> Between:
    """Return the cells that some of the pixels lie between."""
    before, after, nearness = places
    return before[part], after[part], nearness[part]


def _near(cells: Float32Array, down: Between, across: Between) -> Float32Array:
    """Return those of the cells (..., M, N) that a block of pixels lies between."""
    return cells[..., down[0][0] : down[1][-1] + 1, across[0][0] : across[1][-1] + 1]


def _interpolated(cells: Float32Array, down: Between, across: Between) -> Float32Array:
    """Return values (..., M, N) of cells interpolated bilinearly at a block of h x w pixels."""
    (above, under, low), (left, right, far), near = down, across, _near(cells, down, across)
    lines: Float32Array = near.take(left - left[0], axis=-1)
    lines += far * (near.take(right - left[0], axis=-1) - lines)
    values: Float32Array = lines.take(above - above[0], axis=-2)
    values += low[:, None] * (lines.take(under - above[0], axis=-2) - values)
    return values


def _below_black(sharp: FloatImage, step: int, threads: int | None) -> NDArray[np.float32]:
    """Return the mean depth below zero, of the channel where it is largest, in cells of `step` x `step` px."""
    below = np.empty([-(-n // step) for n in sharp.shape[:2]], dtype=np.float32)
    rows = 16  # of cells, measured at a time

    def measure(_: int, top: int) -> None:
        light, cells = sharp[top * step : (top + rows) * step], below[top : top + rows]
        lowest = np.zeros(light.shape[:2], np.float32)
        # Channel by channel: the minimum along so short an axis takes NumPy several times as long.
        for channel in np.moveaxis(light, -1, 0):
            np.minimum(lowest, channel, out=lowest)
        tops, lefts = (step * np.arange(n) for n in cells.shape)
        areas = np.multiply.outer(np.diff(tops, append=len(light)), np.diff(lefts, append=light.shape[1]))
        cells[...] = -np.add.reduceat(np.add.reduceat(lowest, tops, axis=0), lefts, axis=1) / areas

    share(measure, range(0, len(below), rows), threads)
    return below


class UndershootMeter:
    """Measurement of the light below black that deblurring adds, chunk by chunk; a picture has `height` rows."""

    def __init__(self, height: int) -> None:
        # Every eighth row is measured, or at least 64 rows.
        self._step = int(np.clip(height // 64, 1, 8))
        # Not row 0, because the first row of the frame rings more than others.
        self._first = self._step // 2
        self._rows = np.zeros((4, len(range(self._first, height, self._step))))

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

    def ringing(self) -> float:
        """Return the ringing, see :class:`rsdeblur.estimate.QualityCheck`."""
        mean, square, before, after = self._rows.mean(axis=1).tolist()
        return float(np.sqrt(max((after - before) / max(square - mean**2, 1e-12), 0.0)))


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
    height, width, channels = sharp.shape
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

    limits = np.ascontiguousarray(np.moveaxis(np.concatenate([least, most], axis=2), -1, 0))
    down, across = (_between(*each) for each in zip((height, width), near.shape, step, strict=True))

    def limit_block(_: int, rows: slice, cols: slice) -> None:
        places = _cut(down, rows), _cut(across, cols)
        if _near(near, *places).any():
            with np.errstate(over="ignore", invalid="ignore"):
                _limit(sharp[rows, cols], _interpolated(near, *places), *np.split(_interpolated(limits, *places), 2))

    share_blocks(limit_block, (height, width), BLOCK, threads)


def _limit(light: FloatImage, weight: Float32Array, least: Float32Array, most: Float32Array) -> None:
    """Limit luma and chroma of light (h, W, C) in place; pixels brighter than full scale stay.

    The `weight` (h, W) is from 0, which changes nothing, to 1. `least` and `most` are limits (C + 1, h, W) of the luma
    and of the C values of the chroma.
    """
    channels = np.ascontiguousarray(np.moveaxis(light, -1, 0))
    parts = _parts(np.copysign(np.sqrt(np.abs(channels)), channels))
    beyond = ((parts < least) | (parts > most)).any(axis=0) & (weight > 0) & (parts[0] <= 1)
    y, x = np.nonzero(beyond)
    bounded = parts[:, y, x].clip(least[:, y, x], most[:, y, x])
    roots, here = bounded[0] + bounded[1:], channels[:, y, x]
    light[y, x] = (here + weight[y, x] * (roots * np.abs(roots) - here)).T


def _parts(roots: Float32Array) -> Float32Array:
    """Return luma and chroma (C + 1, h, W) of square roots of light (C, h, W)."""
    luma = roots.mean(axis=0, keepdims=True)
    return np.concatenate([luma, roots - luma])


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
            parts = _parts(np.sqrt(np.maximum(np.ascontiguousarray(np.moveaxis(cells, -1, 0)), 0)))
            lefts = np.arange(0, parts.shape[2], step[1])
            lowest[n, first:end] = np.minimum.reduceat(parts.min(axis=1), lefts, axis=1).T
            highest[n, first:end] = np.maximum.reduceat(parts.max(axis=1), lefts, axis=1).T

    share(measure, range(len(needed)), threads)
    return lowest, highest
