"""Highlights beyond full scale: found where the picture is clipped, removed before the solve, added back after it.

The clipped trail of a lamp is not a blurred lamp, and a lamp is so bright that a small error of its PSF outshines its
surroundings. Both make streaks, in every mode and with every prior. So the picture g is separated into highlights l,
which are estimated on their own, and a remainder without highlights, which is solved as usual:

    g = A l + remainder,    restored = l + solved(remainder).

Highlights are never negative, and they lie only where the light of clipped pixels can have come from: in boxes around
these pixels, outside of which the picture does not change. The Richardson-Lucy iteration, accelerated as by Biggs and
Andrews (Applied Optics 36, 1997), keeps both properties. A clipped pixel demands no more than to be at least as bright
as it is recorded (Whyte et al., IJCV 110, 2014). Pixels that highlights spoil are filled in from their surroundings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial, reduce
from math import ceil
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util.threads import share_map, thread_count
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage

Mask = NDArray[np.bool_]
Result = TypeVar("Result")

# Share of full scale, 250 of 255, from which a pixel counts as clipped if it touches one at full scale: JPEG and
# resampling soften the edges of clipped spots.
NEAR = 0.98
# Least share of a point's light that must have reached clipped pixels for the point to be a highlight.
SEEN = 0.2
# The trail of a lamp is larger than the lamp. A spot is a wall, the sky or a sheet of paper, and stays, if points that
# sent more than MOSTLY of their light to it cover more than WALL of it.
MOSTLY, WALL = 0.7, 0.5
# The same holds for a spot whose surroundings have more light than BRIGHT, and for a spot with more pixels than a
# square of WIDEST PSFs: trails are smaller.
BRIGHT, WIDEST = 0.5, 5
# Distance from clipped pixels, px, up to which pixels are spoiled too. Spoiled are also all pixels to which highlights
# give more than LIT of light: PSFs have errors of some percent of that.
SPOILED, LIT = 2, 0.03
# Accelerated steps; they leave the streaks that 30 plain ones leave.
ITERATIONS = 8
# Least divisor in units of light, and standard deviation of the Gaussian that smooths filled pixels, px.
DARK, SMOOTH = 1e-3, 2.0
# Share of a picture that small spots cover at most where they are a few lamps and glints. By day, more are white things
# in the sun, of which only the smallest are glints, up to the second share (docs/developer/reliability.md).
MOST_SPOTS, GLINTS = 5e-3, 1e-3
# Median light of a picture below which it is dark: nights of lamps have 0.025, pictures by day 0.09 and more.
NIGHT = 0.05
# The ends of boxes lie at multiples of this, px.
CELL = 8


class Spot(NamedTuple):
    """Connected clipped pixels: their bounding box, and a mask (h, w, C) of the clipped values in it."""

    rows: slice
    cols: slice
    lost: Mask


class Patch(NamedTuple):
    """A box of the picture: its sharp highlights and its blurred remainder, both (h, w, C) in linear light."""

    rows: slice
    cols: slice
    highlights: FloatImage
    remainder: FloatImage


@dataclass(frozen=True, slots=True)
class HighlightSplit:
    """A picture separated into highlights and a remainder."""

    encoded: EncodedImage
    patches: tuple[Patch, ...] = ()  # boxes that contain highlights; they do not overlap

    def remainder(self, rows: slice, step: int = 1, *, threads: int | None = 1) -> FloatImage:
        """Return linear light of `rows` without highlights; `step` selects every `step`-th row and column."""
        first, stop, _ = rows.indices(self.encoded.shape[0])
        some = replace(self.encoded, values=self.encoded.values[first:stop:step, ::step])
        light = some.linear(slice(None), threads=threads)
        for patch in self.patches:
            top, bottom = max(patch.rows.start, first), min(patch.rows.stop, stop)
            if top >= bottom:
                continue
            down, across = -(top - first) % step, -patch.cols.start % step
            part = patch.remainder[top - patch.rows.start + down : bottom - patch.rows.start : step, across::step]
            row, col = (top - first + down) // step, (patch.cols.start + across) // step
            light[row : row + part.shape[0], col : col + part.shape[1]] = part
        return light

    def add_highlights(self, light: FloatImage, first: int) -> None:
        """Add the highlights to the sharp `light` of the picture's rows from `first` on."""
        for patch in self.patches:
            top, bottom = max(patch.rows.start, first), min(patch.rows.stop, first + light.shape[0])
            if top < bottom:
                start = patch.rows.start
                light[top - first : bottom - first, patch.cols] += patch.highlights[top - start : bottom - start]


def at_full_scale(values: NDArray[Any]) -> Mask:
    """Return which encoded values are at full scale: 255, 65535, or 1 in a float picture that nowhere exceeds it."""
    white = full_scale(values)
    full: Mask = (values == white) & (values.max() == white)
    return full


def full_scale(values: NDArray[Any]) -> float:
    """Return the full scale of encoded values: 255, 65535 or, of floats, 1."""
    return np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1.0


def find_spots(encoded: EncodedImage) -> list[Spot]:
    """Return the clipped spots of a picture, searched in parts of rows: spots that cross to the next come in pieces."""
    height, width, channels = encoded.shape
    values = encoded.values[..., :channels]
    if values.max() > full_scale(values):
        return []
    rows = max(1, 3_000_000 // width)  # bounds the memory to some 70 MB
    return [spot for top in range(0, height, rows) for spot in _spots(values[top : top + rows], top)]


def small_spots(spots: list[Spot], bank: PsfBank) -> list[Spot]:
    """Return the spots that are no larger than the trails of lamps."""
    widest = (WIDEST * max(bank.size)) ** 2
    return [spot for spot in spots if _area(spot) <= widest]


def lights(spots: list[Spot], encoded: EncodedImage) -> list[Spot]:
    """Return the spots that are lamps and glints: all of few, all by night, and the smallest of many by day."""
    height, width, channels = encoded.shape
    by_size = sorted(spots, key=_area)
    covered = np.cumsum(list(map(_area, by_size))) / (height * width)
    if not spots or covered[-1] <= MOST_SPOTS:
        return spots
    some = EncodedImage(encoded.values[::4, ::4, :channels], encoded.transfer)
    return spots if np.median(some.grey(slice(None))) < NIGHT else by_size[: np.searchsorted(covered, GLINTS, "right")]


def _area(spot: Spot) -> int:
    return int(_any(spot.lost).sum())


def separate_highlights(
    encoded: EncodedImage, spots: list[Spot], bank: PsfBank, *, threads: int | None = None
) -> HighlightSplit:
    """Separate a picture into highlights, at `spots` that are no larger than trails, and a remainder."""
    near = list(_boxes(encoded, spots, bank))
    trails = [spot for each in _of_each(_trails, near, threads) for spot in each]
    return HighlightSplit(encoded, tuple(_of_each(_patch, list(_boxes(encoded, trails, bank)), threads)))


def _of_each(function: Callable[..., Result], boxes: list[_Box], threads: int | None) -> list[Result]:
    """Return what `function` returns for each box. Threads share the boxes, and the work in each if these are few."""
    within = max(1, thread_count(threads) // max(len(boxes), 1))
    return share_map(partial(function, threads=within), boxes, threads)


def filled(light: FloatImage, spoiled: Mask) -> FloatImage:
    """Return `light` (H, W, C) with its spoiled pixels (H, W) filled from the nearest other pixels, smoothed."""
    if not spoiled.any() or spoiled.all():
        return light
    row, col = ndimage.distance_transform_edt(spoiled, return_distances=False, return_indices=True)
    smooth = ndimage.gaussian_filter(light[row, col], (SMOOTH, SMOOTH, 0))
    return np.where(spoiled[..., None], smooth, light)


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """A box of the picture, with the spots in it."""

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
    def linear(self) -> FloatImage:
        """Linear light, shape (h, w, C)."""
        return replace(self.encoded, values=self.encoded.values[self.rows, self.cols]).linear(slice(None))

    def lost(self) -> tuple[Mask, NDArray[np.int32]]:
        """Return a mask (h, w, C) of the clipped values, and for each pixel the number of its spot, from 1, or 0."""
        lost = np.zeros((*self.shape, self.encoded.shape[2]), dtype=np.bool_)
        numbers = np.zeros(self.shape, dtype=np.int32)
        for number, spot in enumerate(self.spots, 1):
            rows, cols = _from(self.rows.start, spot.rows), _from(self.cols.start, spot.cols)
            lost[rows, cols] |= spot.lost
            numbers[rows, cols][_any(spot.lost)] = number
        return lost, numbers

    def blur(self, threads: int) -> TileBlur:
        """Return the planned blur in the box, with kernels on pixels, which unlike paths are never negative."""
        bank = replace(self.bank.cut(self.rows, self.cols), displacements=None, softness=0.0)
        return TileBlur(bank, (*self.shape, self.encoded.shape[2]), threads=threads)


def _spots(values: NDArray[Any], top: int) -> Iterator[Spot]:
    """Yield the spots of some rows: connected values that are at full scale, or nearly so beside one that is."""
    full = at_full_scale(values)
    if not full.any():
        return
    # Integers are compared with an integer: no float copy of the picture is made.
    near: Mask = values >= (ceil(NEAR * full_scale(values)) if values.dtype.kind == "u" else NEAR)
    numbers, count = ndimage.label(_any(near), np.ones((3, 3)))  # pixels at corners touch, too
    has_full = np.zeros(count + 1, dtype=np.bool_)
    has_full[numbers[_any(full)]] = True
    for number, (rows, cols) in enumerate(ndimage.find_objects(numbers), 1):
        if has_full[number]:
            own = near[rows, cols] & (numbers[rows, cols] == number)[..., None]
            yield Spot(_from(-top, rows), cols, own)


def _boxes(encoded: EncodedImage, spots: list[Spot], bank: PsfBank) -> Iterator[_Box]:
    """Yield boxes around spots; boxes that would overlap are merged."""
    shape = encoded.shape[:2]
    # By a PSF, there and back, and for the smoothing.
    reach_down, reach_across = (n + SPOILED + int(4 * SMOOTH) for n in bank.size)
    covered = np.zeros([-(-n // CELL) for n in shape], dtype=np.bool_)
    for spot in spots:
        covered[_cells(spot.rows, reach_down), _cells(spot.cols, reach_across)] = True
    count = -1
    while True:
        numbers, boxes = ndimage.label(covered)
        places = ndimage.find_objects(numbers)
        if boxes == count:
            break
        count = boxes
        for place in places:
            covered[place] = True
    owned: list[list[Spot]] = [[] for _ in places]
    for spot in spots:
        owned[numbers[spot.rows.start // CELL, spot.cols.start // CELL] - 1].append(spot)
    for own, place in zip(owned, places, strict=True):
        rows, cols = (slice(CELL * p.start, min(CELL * p.stop, n)) for p, n in zip(place, shape, strict=True))
        yield _Box(rows, cols, encoded, own, bank)


def _cells(span: slice, reach: int) -> slice:
    """Return the cells within `reach` px of a span of an axis."""
    return slice(max(span.start - reach, 0) // CELL, -(-(span.stop + reach) // CELL))


def _trails(box: _Box, threads: int) -> list[Spot]:
    """Return the spots that may be trails of highlights."""
    lost, numbers = box.lost()
    each = np.arange(1, len(box.spots) + 1)
    sent = reduce(np.maximum, np.moveaxis(box.blur(threads).adjoint(lost.astype(np.float32)), -1, 0))
    kept = ndimage.mean(sent > MOSTLY, numbers, each) < WALL
    if kept.any():
        kept &= ndimage.mean(_around(box.linear, lost).mean(axis=2), numbers, each) < BRIGHT
    return [spot for spot, keep in zip(box.spots, kept, strict=True) if keep]


def _patch(box: _Box, threads: int) -> Patch:
    """Separate a box by accelerated Richardson-Lucy iteration."""
    light, (lost, _), blur = box.linear, box.lost(), box.blur(threads)
    # The same places for all channels; otherwise highlights would have coloured fringes.
    possible = _any(blur.adjoint(lost.astype(np.float32)) > SEEN)[..., None]
    around = _around(light, lost).clip(DARK)
    highlights = before = np.where(possible, (light - around).clip(DARK), np.float32(0))
    step, ahead = np.zeros_like(highlights), 0.0
    for _ in range(ITERATIONS):
        guess = (highlights + np.float32(ahead) * (highlights - before)).clip(0)
        blurred = blur.forward(guess).clip(0) + around
        ratio = light.clip(0) / blurred
        np.maximum(ratio, 1, out=ratio, where=lost)
        before, highlights = highlights, guess * blur.adjoint(ratio).clip(0)
        earlier, step = step, highlights - guess
        # The next guess goes on by the share of the step that repeats the earlier one (eq. 10).
        length = float(np.vdot(earlier, earlier))
        ahead = min(max(float(np.vdot(earlier, step)) / length, 0.0), 1.0) if length > 0 else 0.0
    blurred = blur.forward(highlights).clip(0)
    spoiled = _spoiled(lost) | _any(blurred > LIT)
    return Patch(box.rows, box.cols, highlights, filled(light - blurred, spoiled))


def _spoiled(lost: Mask) -> Mask:
    return ndimage.binary_dilation(_any(lost), iterations=SPOILED)


def _around(light: FloatImage, lost: Mask) -> FloatImage:
    """Return the light without highlights: clipped spots are filled in, where that makes them darker."""
    return np.minimum(filled(light, _spoiled(lost)), light)


def _any(mask: Mask) -> Mask:
    """Return where `mask` holds in any channel; ten times as fast as `numpy.any` along the last axis."""
    return reduce(np.logical_or, np.moveaxis(mask, -1, 0))


def _from(start: int, span: slice) -> slice:
    """Return `span` counted from `start`."""
    return slice(span.start - start, span.stop - start)
