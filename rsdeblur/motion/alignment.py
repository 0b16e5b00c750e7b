"""Frames of one scene referred to one of them, and pictures resampled to one time.

The latent picture u of several frames is the sharp rolling-shutter picture of the reference frame. Another frame is
resampled, so that its pixel p comes to the place x of the reference at which u shows what p sees at its own
mid-exposure. The resampled frame is `g(x) = mean_t u(q(t))` with

    q = K C_r(mid(q_y)) C(t)^T K^-1 p(x),

where C_r is the orientation at the rows of the reference. Its paths `x - q(t)` are as short as those of the frame
alone, whatever the rotation between the frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share
from rsdeblur.choices import Motion
from rsdeblur.kernels.resample import sample, to_spline
from rsdeblur.motion.arguments import check_traceable
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import (
    FIXED_POINT_STEPS,
    ROW_SAMPLES_PER_PIXEL,
    ROWS_TOGETHER,
    SAMPLES_PER_PIXEL,
    BlurPaths,
    Capture,
    exposed_times,
    shown_at,
    small_angle_displacements,
)
from rsdeblur.motion.track import OrientationTrack
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Distance of the rows that are traced where the paths of all rows are needed. Interpolated ones are within 0.003 px of
# the traced ones even where 120 rows take 30 ms to read.
ROW_STEP = 4


def burst_captures(
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    translation: Translation | None = None,
    *,
    motion: Motion = "rotation",
    softness: float = 0.0,
) -> list[Capture]:
    """Return the captures of several exposures, in any order, whose orientations count from one moment.

    The log and the translation must cover all exposures and the times between them. `motion` is the model of the paths
    within each exposure; frames are aligned by the full rotation. Errors are those of
    :meth:`rsdeblur.motion.Capture.from_log`.
    """
    epoch = exposures[0].epoch_ns
    moved = [replace(e, start=e.start + 1e-9 * (e.epoch_ns - epoch), epoch_ns=epoch) for e in exposures]
    spans = np.array([exposure.span(camera) for exposure in moved])
    opens, closes = float(spans.min()), float(spans.max())
    check_traceable(camera, translation)
    track = OrientationTrack.from_log(log, camera, opens, closes, epoch)
    if translation is not None:
        translation = translation.covering(opens, closes, epoch)
    return [
        Capture(_during(track, *span), camera, e, translation, motion, softness)
        for e, span in zip(moved, spans, strict=True)
    ]


def _during(track: OrientationTrack, opens: float, closes: float) -> OrientationTrack:
    """Return the part of a track from the last sample before a span to the first one after it."""
    first = max(int(np.searchsorted(track.t, opens, side="right")) - 1, 0)
    stop = min(int(np.searchsorted(track.t, closes)) + 1, len(track.t))
    return OrientationTrack(track.t[first:stop], track.omega[first:stop], track.rotations[first:stop])


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A frame of a burst, and the reference that it is referred to; both are from :func:`burst_captures`."""

    capture: Capture
    reference: Capture

    def places(self, points: FloatArray) -> FloatArray:
        """Return where the frame shows what the reference shows at `points` (..., 2), both at mid-exposure.

        Places are (x, y) in px; they are NaN where the frame's lens does not show the point.
        """
        if self.capture is self.reference:
            return points
        mid = self.reference.mid(points[..., 1])
        orientation = self.reference.track.at(mid)
        world = np.einsum("...ji,...j->...i", orientation, self.reference.points(points)) + self.reference.position(mid)
        # Rows of a point may be hundreds apart, which takes some steps more than within a frame.
        return shown_at(self.capture, world, points, FIXED_POINT_STEPS + 3)

    def paths(self, rows: FloatArray, cols: FloatArray, per_pixel: float = SAMPLES_PER_PIXEL) -> BlurPaths:
        """Return the paths of the resampled frame at the rows (B,) and columns (S,) of the reference, px."""
        # Two samples per gyro interval follow every bend of the track. Their paths' lengths give the final number.
        samples = 2 * len(self.capture.track.t) + 1
        coarse = BlurPaths(self._displacements(rows, cols, samples), rows, cols)
        samples = max(samples, int(np.ceil(per_pixel * coarse.lengths.max())) + 1)
        return BlurPaths(self._displacements(rows, cols, samples), rows, cols, self.capture.softness)

    def every_row(self, rows: slice, cols: FloatArray) -> BlurPaths:
        """Return the paths of all rows of a part of the reference, counted from its first row.

        Each `ROW_STEP`-th row is traced; between them, paths are interpolated linearly.
        """
        from scipy.interpolate import make_interp_spline  # takes 0.3 s to import; only "rowwise" needs it

        traced = np.append(np.arange(float(rows.start), rows.stop - 1, ROW_STEP), rows.stop - 1.0)
        nodes, every = self.paths(traced, cols, ROW_SAMPLES_PER_PIXEL), np.arange(float(rows.start), rows.stop)
        between = make_interp_spline(traced, nodes.displacements, k=1)(every)
        return BlurPaths(between, every - rows.start, cols, nodes.softness)

    def _displacements(self, rows: FloatArray, cols: FloatArray, samples: int) -> FloatArray:
        paths = np.empty((len(rows), len(cols), samples, 2))
        for first in range(0, len(rows), ROWS_TOGETHER):
            some = slice(first, first + ROWS_TOGETHER)
            paths[some] = self._displacements_of(rows[some], cols, samples)
        return paths

    def _displacements_of(self, rows: FloatArray, cols: FloatArray, samples: int) -> FloatArray:
        points = np.stack(np.meshgrid(cols, rows), axis=-1)
        pixels = self.places(points)
        times = exposed_times(self.capture, pixels[..., 1], samples)
        if self.capture.motion == "small-angle":
            depth = self.capture.depth(pixels)
            return small_angle_displacements(self.capture, times, self.capture.mid(pixels[..., 1]), depth)
        seen = self.capture.points(pixels)
        world = np.einsum("bstji,bsj->bsti", self.capture.track.at(times), seen) + self.capture.position(times)
        # The reference shows these places as near to the points as a frame's blur is long.
        return points[:, :, None] - shown_at(self.reference, world, points[:, :, None], FIXED_POINT_STEPS)


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
