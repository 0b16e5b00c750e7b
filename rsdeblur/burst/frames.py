"""Frames of a burst on the pixels of the reference: resampled, compared with it, and weighted.

Rotation does not explain parallax, moving objects or errors of the motion. Both pictures are compared with equal blur:
the frame is convolved with the PSFs of the reference, and the reference with those of the frame. So what differs is
noise or a misfit, at any blur, and without a deconvolution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

from rsdeblur._util.threads import once
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.highlights import HighlightSplit
from rsdeblur.kernels.resample import sample, to_spline
from rsdeblur.motion.paths import BlurPaths, Capture, places
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
# Standard deviations in px of the smoothing, and half widths of the windows as shares of the shorter side, from coarse
# to fine. The first window is the whole picture.
LEVELS = ((8.0, None), (4.0, 1 / 4), (2.0, 1 / 8), (1.0, 1 / 12))
# Standard deviation of the shift from that of the coarser level, px: windows that do not prove a shift keep that one.
SHIFT_DEVIATION = 0.5
# Gains are measured where the reference has this share of its mean brightness, and are limited.
LEAST_BRIGHT, MOST_GAIN = 0.2, 1e3
# Errors of the shift itself, px.
SHIFT_ERROR = 0.2
# Differences of brightness as a share of it: vignetting, flicker, the camera's own processing.
GAIN_ERROR = 0.01
# Mean squared misfit, in units of its expectation, up to which a frame counts fully, and from which on it is left out.
FULL_WEIGHT, NO_WEIGHT = 4.0, 16.0


@dataclass(frozen=True, slots=True, eq=False)
class FrameFit:
    """How a frame of a burst fits the reference."""

    gain: float  # brightness in units of the reference's
    shift: Float32Array  # what the motion leaves unexplained, (x, y) in px of the reduced picture (2, h, w)
    weights: Float32Array  # from 0 to 1, at each pixel of the reduced reference (h, w)
    support: float  # mean weight over the reference's detail, from 0 to 1
    # Mean square of the errors of both paths together, px^2 of the reduced picture: what is left of the difference
    # where the frame counts.
    path_error: float


def _residual_shift(
    frame: Float32Array, reference: Float32Array, known: Float32Array, blur: float
) -> tuple[Float32Array, float]:
    """Return the shift (2, h, w) of the frame in px, and its gain; `blur` is as for both PSFs together, px^2."""
    shift: Float32Array = np.zeros((2, 2, 2), dtype=np.float32)
    gain, last = 1.0, 1
    for (smoothing, part), here, there in zip(LEVELS, _smoothed(reference), _smoothed(frame), strict=True):
        step = round(smoothing)
        rows, cols = (step / last * np.arange(n) for n in here.shape)
        shift = start = _interpolated(shift, rows, cols) / np.float32(step / last)
        radius = None if part is None else round(max(8, part * min(reference.shape)) / step)
        count = here.size if radius is None else (2 * radius + 1) ** 2
        # Differences are alike over an area, so a window counts as so many times fewer pixels.
        alike = 4 * np.pi * (smoothing**2 + blur) / step**2
        prior = step**2 / (max(1.0, count / alike) * SHIFT_DEVIATION**2)
        for _ in range(3):  # Newton steps
            moved = _sampled(there, shift)
            gain = _gain(here, moved, known[::step, ::step])
            moved /= np.float32(gain)
            change = _newton_step(here, moved, known[::step, ::step], _window_mean(radius), prior, shift - start)
            shift = shift + change.clip(-smoothing / step, smoothing / step).astype(np.float32)
        last = step
    return shift, gain


def _smoothed(picture: Float32Array) -> list[Float32Array]:
    """Return the picture at all `LEVELS`, each with one pixel per standard deviation, computed from the finer one."""
    pictures, last = [], 0.0
    for smoothing, _ in reversed(LEVELS):
        spacing = max(1, round(last))
        step = round(smoothing) // spacing
        picture = ndimage.gaussian_filter(picture, (smoothing**2 - last**2) ** 0.5 / spacing)[::step, ::step]
        pictures.append(picture)
        last = smoothing
    return pictures[::-1]


def _gain(here: Float32Array, moved: Float32Array, known: Float32Array) -> float:
    """Return the median ratio of the shifted frame to the reference, which no moving thing can change."""
    bright = (known > 0) & (here > LEAST_BRIGHT * here.mean())
    if not bright.any():
        return 1.0
    ratio = float(np.median(moved[bright] / here[bright]))
    return float(np.clip(ratio, 1 / MOST_GAIN, MOST_GAIN))


def _newton_step(
    here: Float32Array,
    moved: Float32Array,
    known: Float32Array,
    mean: Callable[[NDArray[np.floating]], NDArray[np.floating]],
    prior: float,
    distance: Float32Array,
) -> NDArray[np.floating]:
    """Return the step of Newton's method (2, h, w) from the frame `moved` so far towards the reference, px.

    `mean` averages over windows. `prior` times the unexplained difference is the weight of the coarser level's shift,
    from which the present one has the `distance` (2, h, w).
    """
    dy, dx = np.gradient(here)
    difference = here - moved
    # Outliers, such as a thing that moves, count less.
    typical = float(np.median(np.abs(difference[known > 0]))) if known.any() else 0.0
    trust = known / (1.0 + np.square(difference / max(3.0 * typical, 1e-12)))
    products = dx * dx, dx * dy, dy * dy, dx * difference, dy * difference, difference * difference
    xx, xy, yy, x, y, left = (mean(trust * product) for product in products)
    # A little of the trace keeps windows with one direction solvable. What no shift explains counts as noise.
    weight = left * prior
    ridge = weight + 0.02 * 0.5 * (xx + yy) + 1e-20
    x, y = x - weight * distance[0], y - weight * distance[1]
    xx, yy = xx + ridge, yy + ridge
    return np.stack([yy * x - xy * y, xx * y - xy * x]) / (xx * yy - xy * xy)


def _window_mean(radius: int | None) -> Callable[[NDArray[np.floating]], NDArray[np.floating]]:
    """Return a function that averages over a window around each pixel; None is the whole picture."""
    if radius is None:
        return lambda values: np.full(values.shape, values.mean())
    # Two boxes make a tent, whose weights fall smoothly.
    return lambda values: ndimage.uniform_filter(ndimage.uniform_filter(values, radius + 1), radius + 1)


def _sampled(picture: Float32Array, shift: Float32Array) -> Float32Array:
    """Return a picture (h, w) at places that differ from its pixels by `shift` (2, h, w), linearly interpolated."""
    places = np.indices(picture.shape, dtype=np.float32) + shift[::-1]
    values: Float32Array = ndimage.map_coordinates(picture, places, order=1, mode="nearest", output=np.float32)
    return values


@dataclass(frozen=True, eq=False)
class BurstFrame:
    """One frame of a burst."""

    split: HighlightSplit  # readout along y, without its highlights if these are to be separated
    capture: Capture
    reference: Capture  # of the frame that others are referred to
    tuning: Tuning
    fit: FrameFit | None = None  # None before it is compared, and for the reference

    def paths(self, rows: FloatArray, cols: FloatArray) -> BlurPaths:
        """Return the paths of the resampled frame at the rows (B,) and columns (S,) of the reference, px."""
        return BlurPaths.from_capture(self.capture, rows, cols, reference=self.reference)

    @property
    def encoded(self) -> EncodedImage:
        """The picture with its highlights."""
        return self.split.encoded

    @once
    def offsets(self) -> Float32Array:
        """Place in the frame minus place in the reference, (x, y) in px, at nodes `NODE_STEP` px apart (2, m, n)."""
        rows, cols = (np.arange(0.0, n + NODE_STEP, NODE_STEP) for n in self.encoded.shape[:2])
        points = np.stack(np.meshgrid(cols, rows), axis=-1)
        moved = points
        if self.fit is not None:
            shift = _interpolated(self.fit.shift, *self._reduced(rows, cols))
            moved = points + self.factor * np.moveaxis(shift, 0, -1)
        offsets = places(self.capture, self.reference, moved) - points
        values: Float32Array = np.moveaxis(offsets, -1, 0).astype(np.float32)
        return values

    @once
    def factor(self) -> int:
        """Whole factor by which pictures are reduced for the comparison, to about 640 px."""
        return max(1, round(max(self.encoded.shape[:2]) / 640))

    @once
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

    @once
    def grey_noise(self) -> float:
        """Standard deviation of the noise of :attr:`grey`."""
        return noise_level(self.grey[..., None])

    def light(self, rows: slice, threads: int | None = None) -> tuple[FloatImage, Float32Array]:
        """Return light (rows, W, C) of the frame at `rows` of the reference, as bright, and its weights (rows, W)."""
        assert self.fit is not None
        height, width, channels = self.encoded.shape
        grid = np.arange(float(rows.start), float(rows.stop)), np.arange(float(width))
        x, y = self._places(*grid)
        seen = self._shows(x, y)
        weights = _interpolated(self.fit.weights[None], *self._reduced(*grid))[0] * seen
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
        return self.fit.weights * self._shows(*self._reduced_places())

    def _shows(self, x: Float32Array, y: Float32Array) -> NDArray[np.bool_]:
        """Return whether places of the frame lie in it."""
        height, width, _ = self.encoded.shape
        across, down = (x >= -ROUNDING) & (x <= width - 1 + ROUNDING), (y >= -ROUNDING) & (y <= height - 1 + ROUNDING)
        return across & down

    def _places(self, rows: NDArray[np.floating], cols: NDArray[np.floating]) -> tuple[Float32Array, Float32Array]:
        """Return the places x and y in the frame of a grid of the reference, each of shape (len(rows), len(cols))."""
        x, y = _interpolated(self.offsets, rows / NODE_STEP, cols / NODE_STEP)
        return x + cols.astype(np.float32), y + rows.astype(np.float32)[:, None]

    def _reduced_places(self) -> tuple[Float32Array, Float32Array]:
        """Return the places in the frame of the pixels of the reduced reference."""
        factor = self.factor
        return self._places(*(np.arange(n // factor) * factor + (factor - 1) / 2 for n in self.encoded.shape[:2]))

    def _reduced(self, *places: NDArray[np.floating]) -> list[NDArray[np.floating]]:
        """Return places along an axis in px of the reduced picture."""
        return [(each - (self.factor - 1) / 2) / self.factor for each in places]

    def fitted(self, reference: BurstFrame, banks: tuple[PsfBank, PsfBank]) -> FrameFit:
        """Compare the frame with the reference; `banks` are their PSFs on the reduced picture."""
        own, other = banks
        shape = self.grey.shape
        x, y = self._reduced_places()
        seen = self._shows(x, y).astype(np.float32)
        at = self._reduced(y, x)
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
        blur = (self.tuning.radius**2 + reference.tuning.radius**2) / self.factor**2
        shift, gain = _residual_shift(blurred, equal, known, blur)
        misfit = np.square(_sampled(blurred, shift) / np.float32(gain) - equal)
        slope, tiny = np.square(np.gradient(equal)).sum(axis=0), float(np.finfo(np.float32).tiny)
        energies = [float(np.square(bank.kernels).sum(axis=(2, 3)).mean()) for bank in (other, own)]
        # Variance of the difference, at a gain of 1, and mean square of the errors of both paths, px^2.
        noise = float(np.dot(energies, [frame.grey_noise**2 for frame in (self, reference)]))
        path_error = (self.tuning.path_error + reference.tuning.path_error) / self.factor**2
        mean = _window_mean(6)  # half width, px
        share = np.maximum(mean(known), 1e-6)
        least = noise + (path_error + SHIFT_ERROR**2) * mean(slope * known) / share
        least = least + np.square(GAIN_ERROR * mean(equal))
        ratio = mean(misfit * known) / share / np.maximum(least, tiny)
        if known.any():
            # Elsewhere the weight is that of the nearest known place.
            nearest = ndimage.distance_transform_edt(known == 0, return_distances=False, return_indices=True)
            ratio = ratio[tuple(nearest)]
        fading = np.clip((NO_WEIGHT - ratio) / (NO_WEIGHT - FULL_WEIGHT), 0.0, 1.0)
        weights = (fading * fading * (3.0 - 2.0 * fading)).astype(np.float32)
        trust = weights * known
        support = float((trust * slope).sum() / max(float((slope * known).sum()), tiny))
        left = float((trust * (misfit - np.float32(noise))).sum())
        return FrameFit(gain, shift, weights, support, max(left, 0.0) / max(float((trust * slope).sum()), tiny))


def _interpolated(fields: Float32Array, rows: NDArray[np.floating], cols: NDArray[np.floating]) -> Float32Array:
    """Return `fields` (N, h, w) on a grid of places, linearly interpolated; beyond the edges the nearest value."""
    down, across = (np.arange(n, dtype=np.float64) for n in fields.shape[1:])
    splines = [RectBivariateSpline(down, across, field, kx=1, ky=1) for field in fields]
    return np.array([spline(rows, cols) for spline in splines], dtype=np.float32)


def reduced_bank(paths: BlurPaths, factor: int) -> PsfBank:
    """Return the PSFs of a picture reduced by a whole factor."""
    centre = (factor - 1) / 2
    rows, cols = ((places - centre) / factor for places in (paths.rows, paths.cols))
    return PsfBank.from_paths(BlurPaths(paths.displacements / factor, rows, cols, paths.softness / factor))
