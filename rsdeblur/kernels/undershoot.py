"""Light below black, measured in cells and faded out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array

# Indices (n,) of the cells before and after each of n pixels, and how near each is to the latter, from 0 to 1.
Between = tuple[NDArray[np.intp], NDArray[np.intp], Float32Array]


@njit(nogil=True)
def depths(light, step, below):
    """Measure the mean depth below zero of light in cells, of the channel where it is largest.

    Parameters
    ----------
    light : ndarray, shape (h, W, C), float32
        Linear light of the rows of these cells.
    step : int
        Side of a cell, px; the last ones may be smaller.
    below : ndarray, shape (M, N), float32
        Receives the depths.
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
    """Fade sharp light towards blurred light, by weights that are interpolated bilinearly between cells.

    Parameters
    ----------
    sharp, blurred : ndarray, shape (h, w, C), float32
        Linear light; the former is changed in place where its weight is not 0.
    weight : ndarray, shape (M, N), float32
        Weights of cells.
    down, across : (ndarray, ndarray, ndarray)
        Cells between which the h rows and the w columns lie.
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
