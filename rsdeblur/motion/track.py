"""The orientation track, integrated from a gyro log, and the poses at the rows of a picture.

`OrientationTrack` contains the orientation of the camera, in camera axes and camera time: `C(t)`, camera-from-world,
with `dC/dt = -[omega]x C`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsdeblur._util.one_line import one_line
from rsdeblur.errors import InputError
from rsdeblur.kernels.poses import integrated, orientations, pinhole_paths, row_directions
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray

# Most samples during an exposure: 50 s at 200 Hz, 1.25 s at 8 kHz. Every path has two points for each of them. And most
# samples of a recording of several exposures: 80 minutes at 200 Hz, 2 minutes at 8 kHz.
MOST_SAMPLES, MOST_RECORDED = 10_000, 1_000_000


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class OrientationTrack:
    """Camera orientation `C(t)`, camera-from-world, between the samples of a gyro log.

    Rates are interpolated linearly between samples. Each step is the rotation of the fourth-order Magnus expansion, so
    `C` stays a rotation, and a constant rate is integrated without error.
    """

    t: FloatArray  # (n,), s, camera time
    omega: FloatArray  # (n, 3), rad/s, camera axes
    rotations: FloatArray  # (n, 3, 3), C(t[i]); the first is the identity

    @classmethod
    def from_log(
        cls, log: GyroLog, camera: Camera, t0: float, t1: float, epoch_ns: int, *, most: int = MOST_SAMPLES
    ) -> OrientationTrack:
        """Return the track from the last sample before `t0` to the first one after `t1`, integrated from a gyro log.

        Times are camera time, in s relative to `epoch_ns`. Raise `InputError` if there are more than `most` samples,
        and the errors of :meth:`GyroLog.covering`.
        """
        # camera_time = gyro_time + time_offset
        log = log.covering(t0 - camera.time_offset, t1 - camera.time_offset, epoch_ns)
        check_samples(len(log), t0, t1, most)
        return cls.integrated(log.t + camera.time_offset, log.omega @ camera.imu_to_camera.T)

    @classmethod
    def integrated(cls, t: FloatArray, omega: FloatArray) -> OrientationTrack:
        """Return the track of rates in camera axes at increasing times, over gaps as well."""
        return cls(t, omega, integrated(t, omega))

    def at(self, times: FloatArray) -> FloatArray:
        """Return the matrices `C`, ``times.shape + (3, 3)``, at times within the track, s."""
        return orientations(times, self.t, self.omega, self.rotations)

    def angles(self, times: FloatArray) -> FloatArray:
        """Return the integral of the rates since the first sample, rad, shape ``times.shape + (3,)``.

        It is the small-angle approximation of the rotation, which has no order of axes. Times are within the track, s.
        """
        i = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        elapsed = times - self.t[i]
        share = elapsed / (self.t[i + 1] - self.t[i])
        omega = self.omega[i] + share[..., None] * (self.omega[i + 1] - self.omega[i])
        step = 0.5 * (self.omega[1:] + self.omega[:-1]) * np.diff(self.t)[:, None]
        integral = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
        angles: FloatArray = integral[i] + 0.5 * elapsed[..., None] * (self.omega[i] + omega)
        return angles


def check_samples(count: int, t0: float, t1: float, most: int = MOST_SAMPLES) -> None:
    """Raise `InputError` if a span of time has more than `most` gyro samples."""
    if count > most:
        raise InputError(
            f"the span from {t0:g} s to {t1:g} s has {count} gyro samples, more than {most}; are the duration of the "
            "exposure and the readout time in s?"
        )


@dataclass(frozen=True, slots=True, eq=False)
class RowPoses:
    """Camera poses at the mid-exposures of all H rows of a picture, for projection."""

    camera: Camera
    matrices: FloatArray  # (2 H, 12): C(mid(y)) [I | -P(mid(y))] for the rows y from -H/2 on

    def paths(
        self,
        orientation: FloatArray,
        position: FloatArray,
        scene: FloatArray,
        grid: tuple[FloatArray, FloatArray],
        *,
        steps: int,
    ) -> FloatArray:
        """Return the displacements (B, S, T, 2) of pixels on a grid, (x, y) in px; NaN where the lens shows nothing.

        `grid` contains B rows and S columns in px; the other arguments are those of
        :func:`rsdeblur.kernels.poses.pinhole_paths`. The fixed-point iteration over the rows that points fall on begins
        at the row of the pixel.
        """
        if self.camera.distortion_model == "none":
            pinhole = *self.camera.focal_length, *self.camera.principal_point
            return pinhole_paths(orientation, position, scene, *grid, self.matrices, pinhole, steps)
        rows, cols = grid
        points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None]  # (B, S, 1, 2), x before y
        world = np.einsum("btji,bsj->bsti", orientation, scene) + position[:, None]
        pixels = np.broadcast_to(points, (*world.shape[:-1], 2))
        for _ in range(steps):
            pixels = self.project(world, pixels[..., 1])
        displacements: FloatArray = points - pixels
        return displacements

    def project(self, world: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the pixels (x, y), shape (..., 2), at which points `world` (..., 3) appear by the poses of `rows`.

        Points are directions in world axes, or places in units of the scene's depth. Poses are interpolated linearly
        between rows, which may be fractions; from row to row they differ by at most 1e-4 rad in a picture of thousands
        of rows.
        """
        # A point that the lens does not show has no row: any pose will do, as its position stays NaN.
        return self.camera.project(row_directions(world, rows, self.matrices))
