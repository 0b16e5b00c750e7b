"""Fit of a frame of a burst to the reference: gain, residual shift, and where it shows the same scene.

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

from rsdeblur.types import Float32Array

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
    # Residual shift (x, y) in px of the reduced picture (h, w, 2): what the motion leaves unexplained.
    shift: Float32Array
    weights: Float32Array  # from 0 to 1, at each pixel of the reduced reference (h, w)
    support: float  # mean weight over the reference's detail, from 0 to 1
    # Mean square of the errors of both paths together, px^2 of the reduced picture: what is left of the difference
    # where the frame counts.
    path_error: float


def fit_frame(
    frame: Float32Array, reference: Float32Array, known: Float32Array, *, noise: float, path_error: float, blur: float
) -> FrameFit:
    """Fit a frame to the reference, both (h, w) with the blur of the other added.

    - `known` (h, w) is 1 where both pictures show the scene alone, else 0. There the weight is that of the nearest
      known place.
    - `noise` is the expected variance of the noise of the difference, at a gain of 1.
    - `path_error` is the expected mean square of the errors of the paths, px^2.
    - `blur` is the mean square radius of both PSFs together, px^2.
    """
    shift, gain = _residual_shift(frame, reference, known, blur)
    misfit, slope = np.square(sampled(frame, shift) / np.float32(gain) - reference), _slope(reference)
    mean = _window_mean(6)  # half width, px
    share = np.maximum(mean(known), 1e-6)
    least = noise + (path_error + SHIFT_ERROR**2) * mean(slope * known) / share
    least = least + np.square(GAIN_ERROR * mean(reference))
    ratio = mean(misfit * known) / share / np.maximum(least, np.finfo(np.float32).tiny)
    if known.any():
        nearest = ndimage.distance_transform_edt(known == 0, return_distances=False, return_indices=True)
        ratio = ratio[tuple(nearest)]
    fading = np.clip((NO_WEIGHT - ratio) / (NO_WEIGHT - FULL_WEIGHT), 0.0, 1.0)
    weights = (fading * fading * (3.0 - 2.0 * fading)).astype(np.float32)
    detail = slope * known
    support = float((weights * detail).sum() / max(float(detail.sum()), np.finfo(np.float32).tiny))
    trust = weights * known
    left = float((trust * (misfit - np.float32(noise))).sum())
    path_errors = max(left, 0.0) / max(float((trust * slope).sum()), float(np.finfo(np.float32).tiny))
    return FrameFit(gain, shift, weights, support, path_errors)


def _residual_shift(
    frame: Float32Array, reference: Float32Array, known: Float32Array, blur: float
) -> tuple[Float32Array, float]:
    """Return the shift (h, w, 2) of the frame in px, and its gain."""
    shift: Float32Array = np.zeros((1, 1, 2), dtype=np.float32)
    gain, last = 1.0, 1
    for (smoothing, part), here, there in zip(LEVELS, _smoothed(reference), _smoothed(frame), strict=True):
        step = round(smoothing)
        shift = start = _resized(shift, here.shape, step / last)
        radius = None if part is None else round(max(8, part * min(reference.shape)) / step)
        count = here.size if radius is None else (2 * radius + 1) ** 2
        # Differences are alike over an area, so a window counts as so many times fewer pixels.
        alike = 4 * np.pi * (smoothing**2 + blur) / step**2
        prior = step**2 / (max(1.0, count / alike) * SHIFT_DEVIATION**2)
        for _ in range(3):  # Newton steps
            moved = sampled(there, shift)
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


def _resized(shift: Float32Array, shape: tuple[int, ...], step: float) -> Float32Array:
    """Return a shift field (h, w, 2), in px of its grid, on another grid whose pixels are `step` of these long."""
    resized = np.empty((*shape, 2), dtype=np.float32)
    for axis in range(2):
        ndimage.map_coordinates(
            shift[..., axis], step * np.indices(shape), output=resized[..., axis], order=1, mode="nearest"
        )
    resized /= np.float32(step)
    return resized


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
    """Return the step of Newton's method (h, w, 2) from the frame `moved` so far towards the reference, px.

    `mean` averages over windows. `prior` times the unexplained difference is the weight of the coarser level's shift,
    from which the present one has the `distance` (h, w, 2).
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
    x, y = x - weight * distance[..., 0], y - weight * distance[..., 1]
    xx, yy = xx + ridge, yy + ridge
    step: NDArray[np.floating] = np.stack([yy * x - xy * y, xx * y - xy * x], axis=-1)
    return step / (xx * yy - xy * xy)[..., None]


def _window_mean(radius: int | None) -> Callable[[NDArray[np.floating]], NDArray[np.floating]]:
    """Return a function that averages over a window around each pixel; None is the whole picture."""
    if radius is None:
        return lambda values: np.full(values.shape, values.mean())
    # Two boxes make a tent, whose weights fall smoothly.
    return lambda values: ndimage.uniform_filter(ndimage.uniform_filter(values, radius + 1), radius + 1)


def _slope(picture: Float32Array) -> Float32Array:
    down, across = np.gradient(picture)
    slope: Float32Array = np.square(down) + np.square(across)
    return slope


def sampled(picture: Float32Array, shift: Float32Array) -> Float32Array:
    """Return a picture (h, w) at places that differ from its pixels by `shift` (h, w, 2), linearly interpolated."""
    y, x = np.indices(picture.shape, dtype=np.float32)
    values: Float32Array = ndimage.map_coordinates(
        picture, [y + shift[..., 1], x + shift[..., 0]], order=1, mode="nearest", output=np.float32
    )
    return values
