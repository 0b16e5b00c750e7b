"""Readable NumPy oracles of kernels: tone curves and colours."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from rsdeblur.kernels.chroma import BLUE, DARK, FLAT, GREEN, MOST_RATIO, RED, TINY
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


def to_srgb_numpy(light: Float32Array) -> tuple[NDArray[np.floating], bool]:
    magnitude = np.abs(light)
    values = np.where(magnitude <= END, magnitude * SLOPE, magnitude ** np.float32(1 / GAMMA) * SCALE - OFFSET)
    return np.copysign(values, light), bool(np.isfinite(light).all())
