"""Mending a result cell by cell: light below black fades, luma and chroma keep their limits beside clipped light.

The limits hold for square roots of linear light, which are about as even to the eye as encoded values. The *luma* of a
pixel is the mean of its channels there, its *chroma* is what each channel has more than that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array

# Indices (n,) of the cells before and after each of n pixels, and how near each is to the latter, from 0 to 1.
Between = tuple[NDArray[np.intp], NDArray[np.intp], Float32Array]


@njit(nogil=True)
def depths(light, step, below):
    """Fill `below` (M, N) with the mean depth below zero of light in cells, of the channel where it is largest.

    `light` (h, W, C) has the rows of these cells. Their side is `step` px; the last ones may be smaller.
    """
    height, width, channels = light.shape
    for m in range(below.shape[0]):
        top, bottom = m * step, min(m * step + step, height)
        for n in range(below.shape[1]):
            left, right = n * step, min(n * step + step, width)
            total = np.float32(0.0)
            for y in range(top, bottom):
                for x in range(left, right):
                    lowest = np.float32(0.0)
                    for c in range(channels):
                        lowest = min(lowest, light[y, x, c])
                    total -= lowest
            below[m, n] = total / np.float32((bottom - top) * (right - left))


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


@njit(nogil=True)
def extremes(roots, wide, lowest, highest):
    """Fill `lowest` and `highest` (N, C + 1) with the extremes of luma and chroma in one row of N cells.

    `roots` (h, W, C) has the square roots of the light there. Cells are `wide` px wide; the last one may be smaller.
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


@njit(nogil=True)
def limit(rows, top, tall, wide, weight, least, most):
    """Limit luma and chroma in `rows` (h, W, C) of a picture, in place; pixels brighter than full scale stay.

    The rows are those from `top` on. Cells are `tall` x `wide` px; the last ones may be smaller. At the centres of
    cells hold `weight` (M, N), from 0, which changes nothing, to 1, and the limits `least` and `most` (M, N, C + 1) of
    the luma and of the C values of the chroma. Between them, both are interpolated bilinearly.
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
