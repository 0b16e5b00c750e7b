"""Frames of a burst on the pixels of the reference: resampled, compared with it, and weighted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.burst.fit import FrameFit, fit_frame
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.highlights import HighlightSplit
from rsdeblur.kernels.resample import sample, to_spline
from rsdeblur.motion.alignment import Alignment
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.noise import noise_level
from rsdeblur.tuning.strength import Tuning
from rsdeblur.types import Float32Array, FloatArray, FloatImage

# Distance in px between the points whose places are traced; between them, interpolation errs by less than 0.01 px for
# shifts of up to 100 px.
NODE_STEP = 16
# Places this close to the frame, px, count as in it: its own pixels are found to within rounding.
ROUNDING = 0.01
# Rows beyond a part that the spline of its pixels depends on: it decays by 0.43 from row to row.
SPLINE_ROWS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Warp:
    """Where a frame shows what the reference shows: offsets at nodes, interpolated linearly between them."""

    # Place in the frame minus place in the reference, (x, y) in px, at every `NODE_STEP` px of the reference (m, n, 2).
    offsets: Float32Array

    @classmethod
    def of(cls, alignment: Alignment, residual: Float32Array | None = None) -> Warp:
        """Trace the nodes; `residual` (h, w, 2) is a shift in px of the picture reduced to h x w."""
        camera = alignment.reference.camera
        rows, cols = (np.arange(0.0, n + NODE_STEP, NODE_STEP) for n in (camera.height, camera.width))
        points = np.stack(np.meshgrid(cols, rows), axis=-1)
        moved = points
        if residual is not None:
            factor = camera.width // residual.shape[1]
            at = [(nodes - (factor - 1) / 2) / factor for nodes in (points[..., 1], points[..., 0])]
            shift = [
                ndimage.map_coordinates(part, at, order=1, mode="nearest") for part in np.moveaxis(residual, -1, 0)
            ]
            moved = points + factor * np.stack(shift, axis=-1)
        return cls((alignment.places(moved) - points).astype(np.float32))

    def at(self, rows: FloatArray, cols: FloatArray) -> tuple[Float32Array, Float32Array]:
        """Return the places x and y in the frame of a grid of the reference, each of shape (len(rows), len(cols))."""
        x, y = (_interpolated(part, rows / NODE_STEP, cols / NODE_STEP) for part in np.moveaxis(self.offsets, -1, 0))
        return x + cols.astype(np.float32), y + rows.astype(np.float32)[:, None]


@dataclass(frozen=True, eq=False)
class BurstFrame:
    """One frame of a burst."""

    split: HighlightSplit  # readout along y, without its highlights if these are to be separated
    alignment: Alignment  # of the frame and the reference
    tuning: Tuning
    fit: FrameFit | None = None  # None before it is compared, and for the reference

    @property
    def encoded(self) -> EncodedImage:
        """The picture with its highlights."""
        return self.split.encoded

    @cached_property
    def warp(self) -> Warp:
        """Where the frame shows what the reference shows."""
        return Warp.of(self.alignment, None if self.fit is None else self.fit.shift)

    @cached_property
    def factor(self) -> int:
        """Whole factor by which pictures are reduced for the comparison, to about 640 px."""
        return max(1, round(max(self.encoded.shape[:2]) / 640))

    @cached_property
    def grey(self) -> Float32Array:
        """The frame reduced, channels averaged, shape (h, w)."""
        height, width, channels = self.encoded.shape
        factor = self.factor
        h, w = height // factor, width // factor
        out = np.empty((h, w), dtype=np.float32)
        step = max(1, 64 // factor)
        # Products with constant vectors take a fraction of the time of means over short axes.
        share = np.full(factor * channels, 1 / (factor**2 * channels), dtype=np.float32)
        for top in range(0, h, step):
            stop = min(top + step, h)
            light = self.split.remainder(slice(top * factor, stop * factor))[:, : w * factor]
            rows = (light.reshape(-1, factor * channels) @ share).reshape(stop - top, factor, w)
            rows.sum(axis=1, out=out[top:stop])
        return out

    @cached_property
    def grey_noise(self) -> float:
        """Standard deviation of the noise of :attr:`grey`."""
        return noise_level(self.grey[..., None])

    def light(self, rows: slice, threads: int | None = None) -> tuple[FloatImage, Float32Array]:
        """Return the frame at the `rows` of the reference, and its weight there.

        The light (rows, W, C) is linear, with the brightness of the reference. The weight (rows, W) is from 0 to 1, and
        0 where the frame does not show the place.
        """
        assert self.fit is not None
        height, width, channels = self.encoded.shape
        x, y = self.warp.at(np.arange(rows.start, rows.stop, dtype=float), np.arange(width, dtype=float))
        seen = self._shows(x, y)
        weights = self._weights(rows)
        weights *= seen
        if not seen.any():
            return np.zeros((*x.shape, channels), dtype=np.float32), weights
        top = max(int(y[seen].min()) - SPLINE_ROWS, 0)
        stop = min(int(y[seen].max()) + 1 + SPLINE_ROWS, height)
        source = self.split.remainder(slice(top, stop))
        source /= np.float32(self.fit.gain)
        to_spline(source, threads)
        return sample(source, x.clip(0, width - 1), (y - top).clip(0, stop - 1 - top), threads), weights

    @property
    def shown_weights(self) -> Float32Array:
        """Weight at each pixel of the reduced reference, shape (h, w); 0 where the frame does not show the place."""
        assert self.fit is not None
        weights: Float32Array = self.fit.weights * self._shows(*self._reduced_places())
        return weights

    def _shows(self, x: Float32Array, y: Float32Array) -> NDArray[np.bool_]:
        """Return whether places of the frame lie in it."""
        height, width, _ = self.encoded.shape
        shown: NDArray[np.bool_] = np.logical_and(
            (x >= -ROUNDING) & (x <= width - 1 + ROUNDING), (y >= -ROUNDING) & (y <= height - 1 + ROUNDING)
        )
        return shown

    def _reduced_places(self) -> tuple[Float32Array, Float32Array]:
        """Return the places in the frame of the pixels of the reduced reference."""
        factor = self.factor
        rows, cols = (np.arange(float(n // factor)) * factor + (factor - 1) / 2 for n in self.encoded.shape[:2])
        return self.warp.at(rows, cols)

    def _weights(self, rows: slice) -> Float32Array:
        assert self.fit is not None
        width, centre = self.encoded.shape[1], (self.factor - 1) / 2
        down, across = (
            (np.arange(float(first), float(stop)) - centre) / self.factor
            for first, stop in ((rows.start, rows.stop), (0, width))
        )
        return _interpolated(self.fit.weights, down, across)

    def fitted(self, reference: BurstFrame, banks: tuple[PsfBank, PsfBank]) -> FrameFit:
        """Compare the frame with the reference; `banks` are their PSFs on the reduced picture."""
        own, other = banks
        shape = self.grey.shape
        x, y = self._reduced_places()
        seen = self._shows(x, y).astype(np.float32)
        at = [(places - (self.factor - 1) / 2) / self.factor for places in (y, x)]
        resampled = ndimage.map_coordinates(self.grey, at, order=3, mode="nearest", output=np.float32)
        # Blur mixes pixels with what lies beyond the frame: only the rest can be compared.
        tall, wide = (a + b - 1 for a, b in zip(own.size, other.size, strict=True))
        known = ndimage.minimum_filter(seen, (tall, wide), mode="constant", cval=0.0)
        if not known.any():
            known = seen
        blurred, equal = (
            TileBlur(bank, shape, threads=1).forward(picture)
            for bank, picture in ((other, resampled), (own, reference.grey))
        )
        energies = [float(np.square(bank.kernels).sum(axis=(2, 3)).mean()) for bank in (other, own)]
        noises = [frame.grey_noise**2 for frame in (self, reference)]
        errors = self.tuning.path_error + reference.tuning.path_error
        blur = self.tuning.radius**2 + reference.tuning.radius**2
        return fit_frame(
            *(blurred, equal, known),
            noise=float(np.dot(energies, noises)),
            path_error=errors / self.factor**2,
            blur=blur / self.factor**2,
        )


def _interpolated(values: Float32Array, rows: FloatArray, cols: FloatArray) -> Float32Array:
    """Return `values` on a grid of places, linearly interpolated; beyond the edges the nearest value."""
    for axis, places in enumerate((rows, cols)):
        last = values.shape[axis] - 1
        place = np.clip(places, 0, last)
        first = place.astype(np.intp)
        part = np.expand_dims((place - first).astype(np.float32), 1 - axis)
        before, after = (values.take(nodes, axis) for nodes in (first, np.minimum(first + 1, last)))
        after -= before
        after *= part
        after += before
        values = after
    return values


def reduced_bank(paths: BlurPaths, factor: int) -> PsfBank:
    """Return the PSFs of a picture reduced by a whole factor."""
    centre = (factor - 1) / 2
    rows, cols = ((places - centre) / factor for places in (paths.rows, paths.cols))
    return PsfBank.from_paths(BlurPaths(paths.displacements / factor, rows, cols, paths.softness / factor))
