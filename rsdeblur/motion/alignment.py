"""Frames of one scene referred to one of them, and pictures resampled to one time.

The latent picture u of several frames is the sharp rolling-shutter picture of the reference frame. Another frame is
resampled, so that its pixel p comes to the place x of the reference at which u shows what p sees at its own
mid-exposure. The resampled frame is `g(x) = mean_t u(q(t))` with

    q = K C_r(mid(q_y)) C(t)^T K^-1 p(x),

where C_r is the orientation at the rows of the reference. Its paths `x - q(t)` are as short as those of the frame
alone, whatever the rotation between the frames.
"""

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share
from rsdeblur.kernels.resample import sample, to_spline
from rsdeblur.motion.paths import (
    FIXED_POINT_STEPS,
    ROW_SAMPLES_PER_PIXEL,
    ROWS_TOGETHER,
    BlurPaths,
    Capture,
    enough_samples,
    shown_at,
    traced_in_parts,
)
from rsdeblur.types import FloatArray

# Distance of the rows that are traced where the paths of all rows are needed. Interpolated ones are within 0.003 px of
# the traced ones even where 120 rows take 30 ms to read.
ROW_STEP = 4


def paths_between(capture: Capture, reference: Capture, rows: slice, cols: FloatArray) -> BlurPaths:
    """Return the paths of a resampled frame at all rows of a part of the reference, counted from its first row.

    Each `ROW_STEP`-th row is traced; between them, paths are interpolated linearly.
    """
    from scipy.interpolate import make_interp_spline  # takes 0.3 s to import; only "rowwise" needs it

    every = np.arange(float(rows.start), rows.stop)
    traced = np.append(every[:-1:ROW_STEP], every[-1])
    # The lengths of a few samples' paths give the final number.
    coarse = BlurPaths(traced_in_parts(capture, reference, traced, cols, enough_samples(capture, 0.0)), traced, cols)
    samples = enough_samples(capture, ROW_SAMPLES_PER_PIXEL * float(coarse.lengths.max()))
    paths = make_interp_spline(traced, traced_in_parts(capture, reference, traced, cols, samples), k=1)
    return BlurPaths(paths(every), every - rows.start, cols, capture.softness)


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

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0, readout_time=0.03)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> image, coverage = rsdeblur.motion.rectify(np.ones((48, 64, 3), np.float32), capture)
    >>> image.shape, bool(coverage[24, 32])
    ((48, 64, 3), True)
    """
    height, width, _ = image.shape
    spline = image.copy()
    to_spline(spline, threads)
    out = np.empty_like(image)
    orientation = capture.track.at(capture.middle)
    coverage = np.empty((height, width), dtype=np.bool_)

    def part(_: int, top: int) -> None:
        rows = slice(top, min(top + ROWS_TOGETHER, height))
        points = np.stack(np.meshgrid(np.arange(width), np.arange(rows.start, rows.stop)), axis=-1).astype(np.float64)
        world = capture.points(points) @ orientation + capture.position(capture.middle)
        x, y = np.moveaxis(shown_at(capture, world, points, FIXED_POINT_STEPS), -1, 0)
        coverage[rows] = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
        # The mirrored spline is exact at the border pixels, which are repeated beyond the picture.
        across, down = x.clip(0, width - 1).astype(np.float32), y.clip(0, height - 1).astype(np.float32)
        out[rows] = sample(spline, across, down, threads=1)

    share(part, range(0, height, ROWS_TOGETHER), threads)
    return out, coverage
