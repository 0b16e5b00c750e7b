"""Readable NumPy oracles of `rsdeblur.kernels.ycbcr`."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.ycbcr import FULL, HALF, Coding, Rgb16, Stored


def to_rgb_numpy(luma: Stored, cb: Stored, cr: Stored, coding: Coding, rgb: Rgb16) -> None:
    """Readable twin of :func:`to_rgb`."""
    height, width = luma.shape
    level = (luma - coding.black) / coding.luma_span
    near = np.arange(height) // 2
    other = (near + np.where(np.arange(height) % 2, 1, -1)).clip(0, len(cb) - 1)
    blue, red = (
        ((0.75 * part[near] + 0.25 * part[other] - coding.grey) / coding.chroma_span).repeat(2, axis=1)[:, :width]
        for part in (cb, cr)
    )
    red, blue = 2 * (1 - coding.red) * red, 2 * (1 - coding.blue) * blue
    green = -(coding.red * red + coding.blue * blue) / (1 - coding.red - coding.blue)
    values = np.stack([level + red, level + green, level + blue], axis=-1)
    rgb[...] = np.floor(values.clip(0, 1) * FULL + HALF)


def from_rgb_numpy(rgb: Rgb16, coding: Coding, luma: Stored, cb: Stored, cr: Stored) -> None:
    """Readable twin of :func:`from_rgb`."""
    height, width = luma.shape
    values = rgb / FULL
    level = values @ np.array([coding.red, 1 - coding.red - coding.blue, coding.blue])
    luma[...] = np.floor(level * coding.luma_span + coding.black + HALF)
    for part, channel, weight in ((cb, 2, coding.blue), (cr, 0, coding.red)):
        even = np.pad((values[..., channel] - level) / (2 * (1 - weight)), ((0, height % 2), (0, width % 2)), "edge")
        means = even.reshape(even.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
        part[...] = np.floor((means * coding.chroma_span + coding.grey + HALF).clip(0, 2 * coding.grey - 1))
