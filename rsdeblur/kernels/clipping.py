"""Limits of luma and chroma beside clipped light.

Both work on square roots of linear light, which are about as even to the eye as encoded values. The *luma* of a pixel
is the mean of its channels there, its *chroma* is what each channel has more than that.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit


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
