"""Mending a result cell by cell: light below black fades, luma and chroma keep their limits beside clipped light.

The limits hold for square roots of linear light, which are about as even to the eye as encoded values. The *luma* of a
pixel is the mean of its channels there, its *chroma* is what each channel has more than that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array, FloatImage

# Indices (n,) of the cells before and after each of n pixels, and how near each is to the latter, from 0 to 1.
Between = tuple[NDArray[np.intp], NDArray[np.intp], Float32Array]


def depths(light: FloatImage, step: int, below: Float32Array) -> None:
    """Fill `below` (M, N) with the mean depth below zero of light in cells, of the channel where it is largest.

    `light` (h, W, C) has the rows of these cells. Their side is `step` px; the last ones may be smaller.
    """
    lowest = np.zeros(light.shape[:2], np.float32)
    # Channel by channel: the minimum along so short an axis takes NumPy several times as long.
    for channel in np.moveaxis(light, -1, 0):
        np.minimum(lowest, channel, out=lowest)
    tops, lefts = (step * np.arange(n) for n in below.shape)
    areas = np.multiply.outer(np.diff(tops, append=len(light)), np.diff(lefts, append=light.shape[1]))
    below[...] = -np.add.reduceat(np.add.reduceat(lowest, tops, axis=0), lefts, axis=1) / areas


@njit(nogil=True)
def fade_to(sharp, blurred, weight, down, across):
    """Fade `sharp` light (h, w, C) in place towards `blurred` light, by the weights (M, N) of cells.

    `down` and `across` are the cells between which the h rows and the w columns lie; there, weights are interpolated
    bilinearly.
    """
    above, under, low = down
    left, right, far = across
    for y in range(sharp.shape[0]):
        first, second = weight[above[y]], weight[under[y]]
        for x in range(sharp.shape[1]):
            near = first[left[x]] + low[y] * (second[left[x]] - first[left[x]])
            beyond = first[right[x]] + low[y] * (second[right[x]] - first[right[x]])
            share = near + far[x] * (beyond - near)
            if share != 0:
                for c in range(sharp.shape[2]):
                    sharp[y, x, c] += share * (blurred[y, x, c] - sharp[y, x, c])


def extremes(roots: Float32Array, wide: int, lowest: Float32Array, highest: Float32Array) -> None:
    """Fill `lowest` and `highest` (N, C + 1) with the extremes of luma and chroma in one row of N cells.

    `roots` (h, W, C) has the square roots of the light there. Cells are `wide` px wide; the last one may be smaller.
    """
    parts, lefts = _parts(roots), np.arange(0, roots.shape[1], wide)
    lowest[...] = np.minimum.reduceat(parts.min(axis=0), lefts)
    highest[...] = np.maximum.reduceat(parts.max(axis=0), lefts)


@njit(nogil=True)
def limit(rows, top, tall, wide, weight, least, most):
    """Limit luma and chroma in `rows` (h, W, C) of a picture, in place; pixels brighter than full scale stay.

    The rows are those from `top` on. Cells are `tall` x `wide` px; the last ones may be smaller. At the centres of
    cells hold `weight` (M, N), from 0, which changes nothing, to 1, and the limits `least` and `most` (M, N, C + 1) of
    the luma and of the C values of the chroma. Between them, both are interpolated bilinearly.
    """
    (height, width, channels), (down, across), one = rows.shape, weight.shape, np.float32(1.0)
    parts, bounded = np.empty(channels + 1, np.float32), np.empty(channels + 1, np.float32)
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
            share = luma = np.float32(0.0)
            for k in range(4):
                share += shares[k] * weight[places[k]]
            for c in range(channels):
                parts[c + 1] = np.copysign(np.sqrt(abs(rows[y, x, c])), rows[y, x, c])
                luma += parts[c + 1]
            luma /= np.float32(channels)
            if share == 0 or luma > one:
                continue
            parts[0] = luma
            for n in range(channels + 1):
                parts[n] -= luma if n > 0 else np.float32(0.0)
                lowest = highest = np.float32(0.0)
                for k in range(4):
                    lowest += shares[k] * least[places[k]][n]
                    highest += shares[k] * most[places[k]][n]
                bounded[n] = min(max(parts[n], lowest), highest)
            for c in range(channels):
                # Values within the limits keep their bits.
                if bounded[0] != luma or bounded[c + 1] != parts[c + 1]:
                    changed = bounded[0] + bounded[c + 1]
                    rows[y, x, c] += share * (changed * abs(changed) - rows[y, x, c])


def _parts(roots: Float32Array) -> Float32Array:
    """Return luma and chroma, shape (h, w, C + 1)."""
    # The mean along so short an axis takes NumPy several times as long.
    total = roots[..., :1].copy()
    for c in range(1, roots.shape[2]):
        total += roots[..., c : c + 1]
    luma = total / np.float32(roots.shape[2])
    return np.concatenate([luma, roots - luma], axis=2)
