"""Resampling a sharp rolling-shutter picture to the picture that a global shutter would have recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share
from rsdeblur.kernels.resample import sample, to_spline
from rsdeblur.motion.paths import FIXED_POINT_STEPS, ROWS_TOGETHER, Capture
from rsdeblur.types import FloatArray


def rectify(
    image: NDArray[np.float32], capture: Capture, *, threads: int | None = None
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return a sharp rolling-shutter picture resampled to one time, the mid-exposure of the middle row.

    Output pixel p shows the direction `C(ref)^T K^-1 p`; the rolling-shutter picture shows that direction at
    `q = K C(mid(q_y)) C(ref)^T K^-1 p`, a fixed point in q_y. Values at q come from interpolation by quintic splines.

    Parameters
    ----------
    image : ndarray, shape (H, W, C), float32
        Picture in which each row shows the scene at its own mid-exposure.
    capture : Capture
        The exposure and the motion of the camera during it.
    threads : int, optional
        Number of threads that share the work; default all processors. Any number gives the same bits.

    Returns
    -------
    image : ndarray, shape (H, W, C), float32
        The resampled picture. Pixels that were never exposed repeat the nearest border pixel.
    coverage : ndarray, shape (H, W), bool
        Whether some row was exposed to the scene at this pixel.
    """
    height, width, _ = image.shape
    spline = image.copy()
    to_spline(spline, threads)
    out = np.empty_like(image)
    coverage = np.empty((height, width), dtype=np.bool_)

    def part(_: int, top: int) -> None:
        rows = slice(top, min(top + ROWS_TOGETHER, height))
        x, y = _sources(np.arange(rows.start, rows.stop), width, capture)
        coverage[rows] = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
        # The mirrored spline is exact at the border pixels, which are repeated beyond the picture.
        across, down = x.clip(0, width - 1).astype(np.float32), y.clip(0, height - 1).astype(np.float32)
        out[rows] = sample(spline, across, down, threads=1)

    share(part, range(0, height, ROWS_TOGETHER), threads)
    return out, coverage


def _sources(rows: NDArray[np.intp], width: int, capture: Capture) -> tuple[FloatArray, FloatArray]:
    """Return where the rolling-shutter picture shows the pixels of the output `rows`: x and y, (len(rows), width)."""
    points = np.stack(np.meshgrid(np.arange(width), rows), axis=-1).astype(np.float64)
    world = capture.points(points) @ capture.track.at(capture.middle) + capture.position(capture.middle)
    q = points
    for _ in range(FIXED_POINT_STEPS):
        q = capture.row_poses.project(world, q[..., 1])
    return q[..., 0], q[..., 1]
