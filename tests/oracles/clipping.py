"""Readable NumPy oracles of `rsdeblur.kernels.clipping`."""

from __future__ import annotations

import numpy as np

from rsdeblur.types import Float32Array, FloatImage


def extremes_numpy(roots: Float32Array, wide: int, lowest: Float32Array, highest: Float32Array) -> None:
    """Readable twin of :func:`extremes`."""
    parts, lefts = _parts(roots), np.arange(0, roots.shape[1], wide)
    lowest[...] = np.minimum.reduceat(parts.min(axis=0), lefts)
    highest[...] = np.maximum.reduceat(parts.max(axis=0), lefts)


def limit_numpy(
    rows: FloatImage,
    top: int,
    tall: int,
    wide: int,
    weight: Float32Array,
    least: Float32Array,
    most: Float32Array,
) -> None:
    """Readable twin of :func:`limit`."""
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
