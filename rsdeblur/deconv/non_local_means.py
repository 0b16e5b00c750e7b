"""Denoising by non-local means, in blocks that threads share."""

from __future__ import annotations

import numpy as np

from rsdeblur._util.threads import share_blocks, thread_count
from rsdeblur.kernels.nlm import HALO, PATCH, WORK, average_alike
from rsdeblur.types import FloatImage

# Softness of the weights in variances of the noise. From 0.7 to 1.5 the results differ by 0.3 dB.
SOFTNESS = 0.8
# Height and width of the blocks that a thread works on, px. With the halo, three planes take 0.3 MB.
BLOCK = 64, 256


def non_local_means(image: FloatImage, sigma: float, *, threads: int | None = None) -> FloatImage:
    """Return a picture without white noise.

    Parameters
    ----------
    image : ndarray, shape (H, W) or (H, W, C), float32
        Linear light; mirrored at the borders.
    sigma : float
        Standard deviation of the noise.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Returns
    -------
    ndarray of the same shape, float32
    """
    deep = image.reshape(*image.shape[:2], -1)
    height, width, channels = deep.shape
    padded = np.pad(deep, [(HALO, HALO), (HALO, HALO), (0, 0)], mode="symmetric")
    planes = np.ascontiguousarray(padded.transpose(2, 0, 1), dtype=np.float32)
    work = np.empty((thread_count(threads), WORK, BLOCK[1] + 2 * PATCH), dtype=np.float32)
    variance, softness = np.float32(sigma**2), np.float32(SOFTNESS * sigma**2)
    result = np.empty_like(deep, dtype=np.float32)

    def block(thread: int, rows: slice, columns: slice) -> None:
        around = planes[:, rows.start : rows.stop + 2 * HALO, columns.start : columns.stop + 2 * HALO]
        wide = columns.stop - columns.start
        out = np.empty((channels + 1, rows.stop - rows.start, wide), dtype=np.float32)
        average_alike(around, variance, softness, work[thread, :, : wide + 2 * PATCH], out)
        result[rows, columns] = out[:-1].transpose(1, 2, 0)

    share_blocks(block, (height, width), BLOCK, threads)
    return result.reshape(image.shape)
