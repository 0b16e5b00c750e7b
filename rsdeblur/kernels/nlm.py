"""Non-local means, weighted averages of the pixels whose surroundings are alike.

A. Buades, B. Coll and J.-M. Morel, "A non-local algorithm for image denoising", CVPR 2005.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit

# Radius of the patches that are compared, which the kernel's sums assume, and of the window around a pixel, px.
PATCH, WINDOW = 2, 6
# Pixels around the picture that the result depends on, on each side.
HALO = PATCH + WINDOW
# Rows of the workspace: squares of five rows, their sums, weights.
WORK = 2 * PATCH + 3


@njit(nogil=True, error_model="numpy")
def average_alike(planes, variance, softness, work, out):
    """Compute the averages of a block.

    The weight of a pixel falls with d, the mean squared difference between its patch and that of the centre, over all
    channels: it is ``(1 - x / 8)^8`` with ``x = max(d - 2 variance, 0) / softness``, which is close to ``exp(-x)``.

    Parameters
    ----------
    planes : ndarray, shape (C, h + 2 HALO, w + 2 HALO), float32
        The block and its surroundings.
    variance : float32
        Variance of the noise.
    softness : float32
        Difference at which x is 1.
    work : ndarray, shape (WORK, w + 2 PATCH), float32
        Workspace.
    out : ndarray, shape (C + 1, h, w), float32
        Output: the averages, and the sums of the weights.
    """
    channels, height, width = planes.shape[0], out.shape[1], out.shape[2]
    size, wide = 2 * PATCH + 1, width + 2 * PATCH
    count = np.float32(channels * size * size)
    unlike = np.float32(1.0) / (np.float32(8.0) * softness * count)
    expected = np.float32(2.0) * variance * count
    sums, weights = work[size], work[size + 1]
    out[:] = np.float32(0.0)
    # Loops run over parts of rows, in one function: calls with slices would cost as much as the work itself.
    for down in range(-WINDOW, WINDOW + 1):
        for left in range(2 * WINDOW + 1):
            for y in range(height + 2 * PATCH):
                squares = work[y % size]
                squares[:] = np.float32(0.0)
                for c in range(channels):
                    here = planes[c, WINDOW + y, WINDOW : WINDOW + wide]
                    there = planes[c, WINDOW + y + down, left : left + wide]
                    for x in range(wide):
                        difference = here[x] - there[x]
                        squares[x] += difference * difference
                row = y - 2 * PATCH
                if row < 0:
                    continue
                # From the top down in every block, so that blocks agree in every bit.
                first, second, third, fourth = (
                    work[(y + 1) % 5],
                    work[(y + 2) % 5],
                    work[(y + 3) % 5],
                    work[(y + 4) % 5],
                )
                for x in range(wide):
                    sums[x] = first[x] + second[x] + third[x] + fourth[x] + squares[x]
                total = out[channels, row]
                for x in range(width):
                    distance = sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3] + sums[x + 4]
                    excess = max(distance - expected, np.float32(0.0))
                    weight = max(np.float32(1.0) - excess * unlike, np.float32(0.0))
                    weight *= weight
                    weight *= weight
                    weights[x] = weight * weight
                    total[x] += weights[x]
                for c in range(channels):
                    there = planes[c, HALO + row + down, PATCH + left : PATCH + left + width]
                    mean = out[c, row]
                    for x in range(width):
                        mean[x] += weights[x] * there[x]
    # Loops over pixels: an operation on arrays, with its error message, takes Numba seconds more to compile.
    for c in range(channels):
        for y in range(height):
            for x in range(width):
                out[c, y, x] /= out[channels, y, x]
