"""Highlights beyond full scale: found where the picture is clipped, taken out before it is solved, put back after.

A clipped trail of a lamp is no blurred lamp, and a lamp is so bright that a small error of its PSF outshines what is
around: both make streaks, in every mode and with every prior. So the picture is parted into highlights l, which are
found by themselves, and a rest, which has none and is solved as usual,

    g = A l + rest,    restored = l + solved(rest).

Highlights are light, so never negative, and stand only where clipped pixels can have come from: in boxes around them,
beyond which the picture is as it was. Richardson-Lucy keeps both; a clipped pixel asks for no more than to be at least
as bright as it is recorded (Whyte et al. 2014 [1]_ model the sensor alike; Cho et al. 2011 [2]_ leave such pixels out).
What highlights spoil is filled in from beside them.

.. [1] O. Whyte, J. Sivic and A. Zisserman, "Deblurring shaken and partially saturated images", IJCV 110, 2014.
.. [2] S. Cho, J. Wang and S. Lee, "Handling outliers in non-blind image deconvolution", ICCV 2011.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage

Mask = NDArray[np.bool_]
Saturation = Literal["ignore", "auto"]
SATURATIONS: tuple[Saturation, ...] = ("ignore", "auto")

# Pixels that share an edge or a corner.
TOUCHING = np.ones((3, 3), dtype=np.bool_)
# Share of full scale that counts as clipped beside pixels at full scale, which JPEG and resampling soften: 250 of 255.
NEAR = 0.98
# Share of a point's light that must have gone to clipped pixels for it to be taken for a highlight.
SEEN = 0.2
# A trail is larger than what left it. Where points that sent so much of their light to a spot take up so much of it,
# it is a wall, the sky, a sheet of paper: little was cut off, and filling it in would cost more than it mends.
MOSTLY, WALL = 0.7, 0.5
# So is a spot whose surroundings have more light than this, and without a closer look one of more than the square of so
# many PSFs: a trail that is no wall by the above is shorter.
BRIGHT, WIDEST = 0.5, 5
# Around clipped pixels so many px are spoiled too, and all that highlights give more than this light to: PSFs are good
# to some percent of it.
SPOILED, LIT = 2, 0.03
ITERATIONS = 30
# Least light that is divided by, and standard deviation in px of what smooths the filling.
DARK, SMOOTH = 1e-3, 2.0
# Boxes reach as far beyond their spots as PSFs do from there and back, and as the filling is smoothed. They end at
# whole cells of so many px.
MARGIN, CELL = SPOILED + int(4 * SMOOTH), 8
# Pixels that spots are looked for in at a time: bounds the memory to some 70 MB.
LOOKED_AT = 3_000_000
# Bytes that a box takes for each of its values while it is parted (measured: 108 to 134), and as a patch afterwards.
BOX_BYTES, PATCH_BYTES = 150, 8


class Spot(NamedTuple):
    """Clipped pixels that touch: where they are, and which of the values there, shape (h, w, C)."""

    rows: slice
    cols: slice
    lost: Mask


class Patch(NamedTuple):
    """A box of the picture as highlights, sharp, and the blurred rest; both of shape (h, w, C), linear light."""

    rows: slice
    cols: slice
    highlights: FloatImage
    remainder: FloatImage


@dataclass(frozen=True, slots=True)
class HighlightSplit:
    """A picture without its highlights, which are kept aside.

    Parameters
    ----------
    stored : Stored
        The picture.
    patches : tuple of Patch
        Boxes that hold highlights; they do not overlap.
    """

    encoded: EncodedImage
    patches: tuple[Patch, ...] = ()

    def remainder(self, rows: slice, step: int = 1) -> FloatImage:
        """Return linear light of `rows` without highlights; with `step` of every so manieth of them and of columns."""
        first, stop, _ = rows.indices(self.encoded.shape[0])
        light = replace(self.encoded, values=self.encoded.values[first:stop:step, ::step]).linear(slice(None))
        for patch in self.patches:
            top, bottom = max(patch.rows.start, first), min(patch.rows.stop, stop)
            if top >= bottom:
                continue
            down, across = -(top - first) % step, -patch.cols.start % step
            separate_highlights = patch.remainder[
                top - patch.rows.start + down : bottom - patch.rows.start : step, across::step
            ]
            row, col = (top - first + down) // step, (patch.cols.start + across) // step
            light[row : row + separate_highlights.shape[0], col : col + separate_highlights.shape[1]] = (
                separate_highlights
            )
        return light

    @property
    def nbytes(self) -> int:
        """Memory that the patches take."""
        return sum(patch.highlights.nbytes + patch.remainder.nbytes for patch in self.patches)

    def add_highlights(self, light: FloatImage, first: int) -> None:
        """Add the highlights to sharp `light`, rows of the picture from `first` on."""
        for patch in self.patches:
            top, bottom = max(patch.rows.start, first), min(patch.rows.stop, first + light.shape[0])
            if top < bottom:
                start = patch.rows.start
                light[top - first : bottom - first, patch.cols] += patch.highlights[top - start : bottom - start]


def clipped(values: NDArray[Any]) -> Mask:
    """Return which values are clipped: full scale, and those beside it that are nearly so.

    Parameters
    ----------
    values : ndarray, shape (H, W, C), uint8, uint16 or float
        As stored, without alpha. Floats that exceed 1 anywhere were not clipped there.
    """
    integer = values.dtype.kind == "u"
    white = np.iinfo(values.dtype).max if integer else 1.0
    if values.max() != white:
        return np.zeros(values.shape, dtype=np.bool_)
    # Beside a whole number, integers are compared as they are.
    near: Mask = values >= (ceil(NEAR * white) if integer else NEAR)
    spots, count = ndimage.label(_any(near), TOUCHING)
    full = np.zeros(count + 1, dtype=np.bool_)
    full[spots[_any(values == white)]] = True
    return near & full[spots][..., None]


def find_spots(encoded: EncodedImage) -> list[Spot]:
    """Return the clipped spots of a picture; those that cross rows at which the look is cut come in pieces."""
    height, width, channels = encoded.shape
    values = encoded.values[..., :channels]
    if values.dtype.kind != "u" and values.max() > 1:
        return []
    rows = max(1, LOOKED_AT // width)
    return [spot for top in range(0, height, rows) for spot in _spots(clipped(values[top : top + rows]), top)]


def separate_highlights(
    encoded: EncodedImage,
    spots: list[Spot],
    bank: PsfBank,
    *,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> HighlightSplit:
    """Take the highlights out of a picture.

    Parameters
    ----------
    stored : Stored
        The picture.
    spots : list of Spot
        Of that picture, see :func:`find_spots`.
    bank : PsfBank
        PSFs of the picture.
    threads : int, optional
        Threads that share the work; default all processors.
    max_memory : int, optional
        Bytes that the work may take.
    progress : callable, optional
        Called with the finished fraction.

    Raises
    ------
    InputError
        If `max_memory` is too little.
    """
    widest = (WIDEST * max(bank.size)) ** 2
    spots = [spot for spot in spots if spot.lost.any(axis=2).sum() <= widest]
    near = list(_boxes(encoded, spots, bank))
    _check_memory(near, max_memory)
    trails = [spot for box in near for spot in _trails(box, threads)]
    boxes = list(_boxes(encoded, trails, bank))
    _check_memory(boxes, max_memory)
    patches: list[Patch] = []
    for n, box in enumerate(boxes):
        patches.append(_patch(box, threads))
        if progress is not None:
            progress((n + 1) / len(boxes))
    return HighlightSplit(encoded, tuple(patches))


def filled(light: FloatImage, spoiled: Mask) -> FloatImage:
    """Fill pixels (H, W) that are spoiled, in any channel, with the nearest others, smoothed."""
    if not spoiled.any() or spoiled.all():
        return light
    row, col = ndimage.distance_transform_edt(spoiled, return_distances=False, return_indices=True)
    smooth = ndimage.gaussian_filter(light[row, col], (SMOOTH, SMOOTH, 0))
    return np.where(spoiled[..., None], smooth, light)


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """A part of the picture, and the spots that have to do with it."""

    rows: slice
    cols: slice
    encoded: EncodedImage
    spots: list[Spot]
    bank: PsfBank

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.rows.stop - self.rows.start, self.cols.stop - self.cols.start

    @property
    def size(self) -> int:
        """Number of values."""
        height, width, channels = *self.shape, self.encoded.shape[2]
        return height * width * channels

    @property
    def linear(self) -> FloatImage:
        """Linear light, shape (h, w, C)."""
        return replace(self.encoded, values=self.encoded.values[self.rows, self.cols]).linear(slice(None))

    def lost(self) -> tuple[Mask, NDArray[np.int32]]:
        """Return which values of the spots are clipped (h, w, C), and the number of each pixel's spot, from 1."""
        lost = np.zeros((*self.shape, self.encoded.shape[2]), dtype=np.bool_)
        numbers = np.zeros(self.shape, dtype=np.int32)
        for number, spot in enumerate(self.spots, 1):
            rows, cols = _from(self.rows.start, spot.rows), _from(self.cols.start, spot.cols)
            lost[rows, cols] |= spot.lost
            numbers[rows, cols][spot.lost.any(axis=2)] = number
        return lost, numbers

    def blur(self, threads: int | None) -> TileBlur:
        """Plan the blur in the box."""
        bank = self.bank.cut(self.rows, self.cols)
        bank = replace(bank, rows=bank.rows - self.rows.start, cols=bank.cols - self.cols.start)
        return TileBlur(bank, (*self.shape, self.encoded.shape[2]), threads=threads)


def _spots(lost: Mask, top: int) -> Iterator[Spot]:
    if not lost.any():
        return
    numbers, _ = ndimage.label(_any(lost), TOUCHING)
    for number, (rows, cols) in enumerate(ndimage.find_objects(numbers), 1):
        own = lost[rows, cols] & (numbers[rows, cols] == number)[..., None]
        yield Spot(_from(-top, rows), cols, own)


def _boxes(encoded: EncodedImage, spots: list[Spot], bank: PsfBank) -> Iterator[_Box]:
    """Yield boxes around spots; where they would overlap they are one."""
    shape = encoded.shape[:2]
    reach_down, reach_across = (n + MARGIN for n in bank.size)
    covered = np.zeros([-(-n // CELL) for n in shape], dtype=np.bool_)
    for spot in spots:
        covered[_cells(spot.rows, reach_down), _cells(spot.cols, reach_across)] = True
    count = -1
    while True:
        numbers, found = ndimage.label(covered)
        places = ndimage.find_objects(numbers)
        if found == count:
            break
        count = found
        for place in places:
            covered[place] = True
    owned: list[list[Spot]] = [[] for _ in places]
    for spot in spots:
        owned[numbers[spot.rows.start // CELL, spot.cols.start // CELL] - 1].append(spot)
    for own, place in zip(owned, places, strict=True):
        rows, cols = (slice(CELL * p.start, min(CELL * p.stop, n)) for p, n in zip(place, shape, strict=True))
        yield _Box(rows, cols, encoded, own, bank)


def _cells(separate_highlights: slice, reach: int) -> slice:
    """Return the cells within `reach` px of a part of an axis."""
    return slice(max(separate_highlights.start - reach, 0) // CELL, -(-(separate_highlights.stop + reach) // CELL))


def _check_memory(boxes: list[_Box], max_memory: int | None) -> None:
    """Refuse a box that takes too much beside all patches."""
    if max_memory is None or not boxes:
        return
    largest = max(boxes, key=lambda box: box.size)
    needed = BOX_BYTES * largest.size + PATCH_BYTES * sum(box.size for box in boxes)
    if needed > max_memory:
        raise InputError(
            f"max_memory is {max_memory >> 20} MiB, but the highlights about row {largest.rows.start} and column "
            f'{largest.cols.start} need {needed >> 20} MiB: allow for that, or take saturation="ignore"'
        )


def _trails(box: _Box, threads: int | None) -> list[Spot]:
    """Return the spots that highlights may have left."""
    lost, numbers = box.lost()
    each = np.arange(1, len(box.spots) + 1)
    sent = box.blur(threads).adjoint(lost.astype(np.float32)).max(axis=2)
    kept = ndimage.mean(sent > MOSTLY, numbers, each) < WALL
    if kept.any():
        kept &= ndimage.mean(_around(box.linear, lost).mean(axis=2), numbers, each) < BRIGHT
    return [spot for spot, keep in zip(box.spots, kept, strict=True) if keep]


def _patch(box: _Box, threads: int | None) -> Patch:
    """Part a box by Richardson-Lucy."""
    light, (lost, _), blur = box.linear, box.lost(), box.blur(threads)
    # One place for all channels, or highlights would have coloured fringes.
    possible = (blur.adjoint(lost.astype(np.float32)) > SEEN).any(axis=2, keepdims=True)
    around = _around(light, lost).clip(DARK)
    found = np.where(possible, (light - around).clip(DARK), np.float32(0))
    for _ in range(ITERATIONS):
        given = blur.forward(found).clip(0) + around
        ratio = light.clip(0) / given
        np.maximum(ratio, 1, out=ratio, where=lost)
        found *= blur.adjoint(ratio).clip(0)
    given = blur.forward(found).clip(0)
    lit = (given > LIT).any(axis=2)
    return Patch(box.rows, box.cols, found, filled(light - given, _spoiled(lost) | lit))


def _spoiled(lost: Mask) -> Mask:
    spoiled: Mask = ndimage.binary_dilation(np.any(lost, axis=2), iterations=SPOILED)
    return spoiled


def _around(light: FloatImage, lost: Mask) -> FloatImage:
    """Return the light that clipped spots would have without highlights."""
    return np.minimum(filled(light, _spoiled(lost)), light)


def _any(mask: Mask) -> Mask:
    """Return what holds in any channel; ten times as fast as NumPy's own."""
    any_channel: Mask = np.logical_or.reduce([mask[..., c] for c in range(mask.shape[2])])
    return any_channel


def _from(start: int, separate_highlights: slice) -> slice:
    """Count from `start`."""
    return slice(separate_highlights.start - start, separate_highlights.stop - start)
