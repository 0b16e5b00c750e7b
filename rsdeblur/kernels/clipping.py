"""Limits of luma and chroma beside clipped light: Numba kernels and their NumPy twins.

Both work on square roots of linear light, which are about as even to the eye as encoded values. The *luma* of a pixel
is the mean of its channels there, its *chroma* is what each channel has more than that.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array, FloatImage


@njit(nogil=True)
def extremes(roots, wide, lowest, highest):
    """Measure the extremes of luma and chroma in one row of cells.

    Parameters
    ----------
    roots : ndarray, shape (h, W, C), float32
        Square roots of the light of the rows of these cells.
    wide : int
        Width of a cell, px; the last one may be smaller.
    lowest, highest : ndarray, shape (N, C + 1), float32
        Receive the extremes of the luma and of the C values of the chroma.
    """
    height, width, channels = roots.shape
    for n in range(len(lowest)):
        for i in range(channels + 1):
            lowest[n, i] = np.inf
            highest[n, i] = -np.inf
    for y in range(height):
        for x in range(width):
            n = x // wide
            luma = np.float32(0.0)
            for c in range(channels):
                luma += roots[y, x, c]
            luma /= np.float32(channels)
            lowest[n, 0] = min(lowest[n, 0], luma)
            highest[n, 0] = max(highest[n, 0], luma)
            for c in range(channels):
                chroma = roots[y, x, c] - luma
                lowest[n, c + 1] = min(lowest[n, c + 1], chroma)
                highest[n, c + 1] = max(highest[n, c + 1], chroma)


def extremes_numpy(roots: Float32Array, wide: int, lowest: Float32Array, highest: Float32Array) -> None:
    """Readable twin of :func:`extremes`."""
    parts, lefts = _parts(roots), np.arange(0, roots.shape[1], wide)
    lowest[...] = np.minimum.reduceat(parts.min(axis=0), lefts)
    highest[...] = np.maximum.reduceat(parts.max(axis=0), lefts)


@njit(nogil=True)
def limit(rows, top, tall, wide, weight, least, most):
    """Limit luma and chroma of a picture, by a weight; pixels brighter than full scale stay.

    Weights and limits hold at the centres of cells, and are interpolated bilinearly.

    Parameters
    ----------
    rows : ndarray, shape (h, W, C), float32
        Linear light of some rows of the picture, changed in place.
    top : int
        Number of the first of them.
    tall, wide : int
        Height and width of a cell, px; the last cells may be smaller.
    weight : ndarray, shape (M, N), float32
        Weights of the cells, in [0, 1]; 0 changes nothing.
    least, most : ndarray, shape (M, N, C + 1), float32
        Limits of the luma and of the C values of the chroma in the cells.
    """
    height, width, channels = rows.shape
    down, across = weight.shape
    one = np.float32(1.0)
    for y in range(height):
        place = min(max((top + y + 0.5) / tall - 0.5, 0.0), down - 1.0)
        above = int(place)
        under, low = min(above + 1, down - 1), np.float32(place - above)
        # Weights are interpolated, so they reach up to the centres of the next cells.
        first, last = across, -1
        for n in range(across):
            if weight[above, n] != 0 or weight[under, n] != 0:
                first, last = min(first, n), n
        for x in range(max((first - 1) * wide, 0), min((last + 2) * wide, width)):
            place = min(max((x + 0.5) / wide - 0.5, 0.0), across - 1.0)
            left = int(place)
            right, far = min(left + 1, across - 1), np.float32(place - left)
            shares = (one - low) * (one - far), (one - low) * far, low * (one - far), low * far
            places = (above, left), (above, right), (under, left), (under, right)
            share = np.float32(0.0)
            for k in range(4):
                share += shares[k] * weight[places[k]]
            if share == 0:
                continue
            luma = np.float32(0.0)
            for c in range(channels):
                luma += _root(rows[y, x, c])
            luma /= np.float32(channels)
            if luma > one:
                continue
            bounded = _bounded(luma, 0, shares, places, least, most)
            for c in range(channels):
                root = _root(rows[y, x, c])
                chroma = _bounded(root - luma, c + 1, shares, places, least, most)
                # Values within the limits keep their bits.
                if bounded != luma or chroma != root - luma:
                    changed = bounded + chroma
                    rows[y, x, c] += share * (changed * abs(changed) - rows[y, x, c])


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


@njit(nogil=True)
def _root(light):
    return np.sqrt(light) if light > 0 else -np.sqrt(-light)


@njit(nogil=True)
def _bounded(value, n, shares, places, least, most):
    low = high = np.float32(0.0)
    for k in range(4):
        low += shares[k] * least[places[k]][n]
        high += shares[k] * most[places[k]][n]
    return min(max(value, low), high)


def _parts(roots: Float32Array) -> Float32Array:
    """Return luma and chroma, shape (h, w, C + 1)."""
    luma = roots.mean(axis=2, keepdims=True)
    return np.concatenate([luma, roots - luma], axis=2)
