"""Readable NumPy oracles of kernels: tone curves, colours and clipped light."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from rsdeblur.kernels.chroma import BLUE, DARK, FLAT, GREEN, MOST_RATIO, RED, TINY
from rsdeblur.kernels.mend import Between
from rsdeblur.kernels.tone import END, GAMMA, OFFSET, SCALE, SLOPE
from rsdeblur.types import Float32Array, FloatImage


def separate_numpy(light: FloatImage) -> tuple[FloatImage, FloatImage]:
    luma = light @ np.array([[RED], [GREEN], [BLUE]])
    height, width = light.shape[:2]
    even = np.pad(light, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
    half = (even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2]) * np.float32(0.25)
    return luma, half


def join_numpy(luma: FloatImage, half: FloatImage, peak: float, out: FloatImage) -> None:
    own = half @ np.array([[RED], [GREEN], [BLUE]])
    mean, square, colour, product = (
        uniform_filter(values, 3, mode="nearest", axes=(0, 1)) for values in (own, own * own, half, own * half)
    )
    flat, dark = (max(np.float32(share), TINY) for share in (FLAT * peak**2, DARK * peak))
    ratio = np.minimum((np.maximum(colour, 0) + dark) / (np.maximum(mean, 0) + dark), MOST_RATIO)
    slope = (product - mean * colour + flat * ratio) / (np.maximum(square - mean * mean, 0) + flat)
    slope, offset = (_doubled(values, luma.shape) for values in (slope, half - slope * own))
    out[...] = slope * luma + offset


def _doubled(values: NDArray[np.floating], shape: tuple[int, ...]) -> NDArray[np.floating]:
    """Return a picture at twice its size, interpolated linearly, cut to a shape."""
    for axis in (0, 1):
        ahead = np.concatenate([values.take([0], axis), values.take(range(values.shape[axis] - 1), axis)], axis)
        after = np.concatenate([values.take(range(1, values.shape[axis]), axis), values.take([-1], axis)], axis)
        pairs = np.stack([0.75 * values + 0.25 * ahead, 0.75 * values + 0.25 * after], axis + 1)
        values = pairs.reshape(*values.shape[:axis], -1, *values.shape[axis + 1 :])
        values = values.take(range(shape[axis]), axis)
    return values


def limit_numpy(
    rows: FloatImage, top: int, tall: int, wide: int, weight: Float32Array, least: Float32Array, most: Float32Array
) -> None:
    (height, width, channels), numbers = rows.shape, np.concatenate([weight[..., None], least, most], axis=2)
    for axis, (first, count, step) in enumerate(((top, height, tall), (0, width, wide))):
        cells = numbers.shape[axis]
        place = np.clip((first + np.arange(count) + 0.5) / step - 0.5, 0.0, cells - 1.0)
        before = place.astype(np.intp)
        share = np.expand_dims((place - before).astype(np.float32), [1, 2] if axis == 0 else [0, 2])
        one, other = (np.take(numbers, where, axis) for where in (before, np.minimum(before + 1, cells - 1)))
        numbers = (1 - share) * one + share * other
    here, low, high = np.split(numbers, [1, channels + 2], axis=2)
    parts = _parts(np.copysign(np.sqrt(np.abs(rows)), rows))
    bounded = parts.clip(low, high)
    changed = bounded[..., :1] + bounded[..., 1:]
    stays = (parts[..., :1] > 1) | ((bounded[..., :1] == parts[..., :1]) & (bounded == parts)[..., 1:])
    rows += np.where(stays, 0, here * (changed * np.abs(changed) - rows))


def _parts(roots: Float32Array) -> Float32Array:
    """Return luma and chroma, shape (h, w, C + 1)."""
    luma = roots.mean(axis=2, keepdims=True)
    return np.concatenate([luma, roots - luma], axis=2)


def to_srgb_numpy(light: Float32Array) -> tuple[NDArray[np.floating], bool]:
    magnitude = np.abs(light)
    values = np.where(magnitude <= END, magnitude * SLOPE, magnitude ** np.float32(1 / GAMMA) * SCALE - OFFSET)
    return np.copysign(values, light), bool(np.isfinite(light).all())


def fade_to_numpy(sharp: FloatImage, blurred: FloatImage, weight: Float32Array, down: Between, across: Between) -> None:
    (above, under, low), (left, right, far) = down, across
    lines = weight[above] + low[:, None] * (weight[under] - weight[above])
    share = lines[:, left] + far * (lines[:, right] - lines[:, left])
    sharp += share[..., None] * (blurred - sharp)
