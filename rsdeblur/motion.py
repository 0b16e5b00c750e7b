"""From orientation to blur: the path that each part of the picture traces while it is exposed.

The blur at output pixel p is the gather `g(p) = mean_t u(q(t))` over p's own exposure window. With
`geometry="keep"` the latent picture u is the rolling-shutter one, each of whose rows shows the scene at that row's
mid-exposure, so q is where the scene point that p sees at time t stands *in that picture*:

    q = K C(mid(q_y)) C(t)^T K^-1 p

The reference time depends on the row that q falls on; the fixed point is reached in a few steps because a picture
moves by far less than a row while a row is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rsdeblur import _validate
from rsdeblur._validate import FloatArray
from rsdeblur.camera import Camera
from rsdeblur.exposure import Exposure
from rsdeblur.gyro import GyroLog, OrientationTrack

Motion = Literal["rotation", "small-angle"]
MOTIONS: tuple[Motion, ...] = ("rotation", "small-angle")

# Time samples per pixel of path. Segments, not dots, are rasterised, so this only has to follow the curve.
SAMPLES_PER_PIXEL = 4

# Rows and columns at which the blur is probed: one per millisecond of an ordinary readout, well within a gyro interval.
PROBES = 33

# Each step of the fixed point shrinks the error by (vertical speed x line time), at most about 0.1 in practice:
# three steps bring a 100 px path to 0.1 px in the worst case, and to 1e-3 px ordinarily.
FIXED_POINT_STEPS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One exposure with the camera's motion during it; the readout runs along y.

    Built by :meth:`from_log`, which validates that the log describes the exposure.
    """

    track: OrientationTrack
    camera: Camera
    exposure: Exposure

    @classmethod
    def from_log(cls, log: GyroLog, camera: Camera, exposure: Exposure) -> Shot:
        """Integrate the part of `log` that the exposure needs.

        Raises
        ------
        CoverageError, ClockError, GapError
            See :meth:`rsdeblur.GyroLog.covering`.
        """
        opens, closes = exposure.span(camera)
        return cls(OrientationTrack.from_log(log, camera, opens, closes, exposure.epoch_ns), camera, exposure)

    def mid(self, rows: FloatArray) -> FloatArray:
        """Return the mid-exposure times of `rows` (rows beyond the picture count as its first or last)."""
        opens, closes = self.exposure.window(np.clip(rows, 0, self.camera.lines - 1), self.camera)
        return 0.5 * (opens + closes)

    def times(self, rows: FloatArray, samples: int) -> FloatArray:
        """Return times spread evenly over each row's window, both ends included; shape (len(rows), samples)."""
        opens, closes = self.exposure.window(rows, self.camera)
        return opens[:, None] + (closes - opens)[:, None] * np.linspace(0.0, 1.0, samples)


@dataclass(frozen=True, slots=True, eq=False)
class BlurPaths:
    """Displacement paths on a grid of rows x columns of the picture.

    Parameters
    ----------
    displacements : ndarray, shape (B, S, T, 2)
        `d = p - q` as (x, y) in px at T times spread evenly over the exposure window of the grid point.
    rows : ndarray, shape (B,)
        Picture rows of the grid, px.
    cols : ndarray, shape (S,)
        Picture columns of the grid, px.
    """

    displacements: FloatArray
    rows: FloatArray
    cols: FloatArray

    @classmethod
    def from_shot(
        cls,
        shot: Shot,
        rows: FloatArray,
        cols: FloatArray,
        *,
        motion: Motion = "rotation",
        samples: int | Literal["auto"] = "auto",
    ) -> BlurPaths:
        """Trace the paths of the pixels at `rows` x `cols`.

        Parameters
        ----------
        shot : Shot
            The exposure and the camera's orientation during it.
        rows, cols : ndarray, shape (B,) and (S,)
            Grid in px.
        motion : {"rotation", "small-angle"}
            The full homography path, or Sindelar and Sroubek (2013), eq. 6: small angles about x and y, the same
            over the whole width.
        samples : int or "auto"
            Number of time samples; "auto" takes at least 4 per pixel of the longest path.
        """
        trace = _rotation_paths if motion == "rotation" else _small_angle_paths
        if samples == "auto":
            # Two samples per gyro interval follow every bend of the track; then refine by the length found.
            coarse = 2 * len(shot.track.t) + 1
            length = _lengths(trace(shot, rows, cols, coarse)).max()
            samples = max(coarse, int(np.ceil(SAMPLES_PER_PIXEL * length)) + 1)
        displacements = trace(shot, rows, cols, _validate.count("samples", samples, minimum=2))
        displacements.setflags(write=False)
        return cls(displacements, rows, cols)

    @property
    def lengths(self) -> FloatArray:
        """Length of each path in px, shape (B, S)."""
        return _lengths(self.displacements)

    @property
    def extent(self) -> tuple[float, float]:
        """Largest displacement along y and along x in px."""
        dx, dy = np.abs(self.displacements).max(axis=(0, 1, 2))
        return float(dy), float(dx)


def _lengths(displacements: FloatArray) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(np.diff(displacements, axis=2), axis=-1).sum(axis=2)
    return lengths


def _rotation_paths(shot: Shot, rows: FloatArray, cols: FloatArray, samples: int) -> FloatArray:
    camera = shot.camera
    points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None, :]  # (B, S, 1, 2), x before y
    directions = rays(points, camera)[:, :, 0]
    orientation = shot.track.at(shot.times(rows, samples))  # (B, T, 3, 3)
    world = np.einsum("btji,bsj->bsti", orientation, directions)
    poses = RowPoses.of(shot)
    # Start at the pixel's own row, whose reference orientation is nearly right.
    q = np.broadcast_to(points, (*world.shape[:-1], 2))
    for _ in range(FIXED_POINT_STEPS if camera.readout > 0 else 1):
        q = poses.project(world, q[..., 1])
    return points - q


def _small_angle_paths(shot: Shot, rows: FloatArray, cols: FloatArray, samples: int) -> FloatArray:
    angles = shot.track.angles(shot.times(rows, samples)) - shot.track.angles(shot.mid(rows))[:, None]
    fx, fy = shot.camera.focal
    # The picture moves by f (-theta_y, +theta_x).
    d = np.stack([-fx * angles[..., 1], fy * angles[..., 0]], axis=-1)
    return np.repeat(d[:, None], len(cols), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RowPoses:
    """Orientation of every row at its own mid-exposure, and the projection with it."""

    matrices: FloatArray  # (H, 9), K C(mid(y))

    @classmethod
    def of(cls, shot: Shot) -> RowPoses:
        """Tabulate the poses of all rows of the picture."""
        rows = np.arange(shot.camera.lines, dtype=np.float64)
        return cls((shot.camera.matrix @ shot.track.at(shot.mid(rows))).reshape(-1, 9))

    def project(self, world: FloatArray, rows: FloatArray) -> FloatArray:
        """Project directions (..., 3) with the poses of `rows` (..., fractions allowed, clamped to the picture).

        Linear between rows: neighbouring poses differ by some 1e-4 rad, so the error is of the order 1e-9.
        """
        last = len(self.matrices) - 1
        rows = np.clip(rows, 0, last)
        i = np.minimum(rows.astype(np.intp), max(last - 1, 0))
        j = np.minimum(i + 1, last)
        pose = self.matrices[i] + (rows - i)[..., None] * (self.matrices[j] - self.matrices[i])
        x, y, z = np.einsum("...ij,...j->i...", pose.reshape(*rows.shape, 3, 3), world)
        q: FloatArray = np.stack([x / z, y / z], axis=-1)
        return q


def rays(points: FloatArray, camera: Camera) -> FloatArray:
    """Directions K^-1 (x, y, 1) of points (..., 2), shape (..., 3)."""
    (fx, fy), (cx, cy) = camera.focal, camera.principal
    x, y = (points[..., 0] - cx) / fx, (points[..., 1] - cy) / fy
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def path_curvature(shot: Shot, *, motion: Motion) -> tuple[float, float]:
    """How far the change of the blur over the picture is from linear.

    Returns
    -------
    down, across : float
        Largest second derivative of the path along the height and along the width, in px per squared picture side:
        paths interpolated linearly between N tiles are wrong by at most `curvature / (8 N^2)` px.
    """
    rows, cols = (np.linspace(0.0, n - 1.0, PROBES) for n in (shot.camera.height, shot.camera.width))
    samples = 2 * len(shot.track.t) + 1
    d = BlurPaths.from_shot(shot, rows, cols, motion=motion, samples=samples).displacements
    bends = (np.linalg.norm(np.diff(d, n=2, axis=axis), axis=-1).max() for axis in (0, 1))
    down, across = (float(bend) * (PROBES - 1) ** 2 for bend in bends)
    return down, across
