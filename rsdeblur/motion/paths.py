"""From orientation to blur: the path that each part of the picture traces while it is exposed.

The blur at output pixel p is the gather `g(p) = mean_t u(q(t))` over p's own exposure window. With
`geometry="keep"` the latent picture u is the rolling-shutter one, each of whose rows shows the scene at that row's
mid-exposure, so q is where the scene point that p sees at time t stands *in that picture*:

    q = K C(mid(q_y)) C(t)^T K^-1 p,

K being the camera's projection, its lens distortion included. With a :class:`~rsdeblur.Translation` the scene stands
at one depth Z, and what p sees is a point (Sindelar and Sroubek 2013, eq. 3):

    q = K C(mid(q_y)) (C(t)^T K^-1 p + (P(t) - P(mid(q_y))) / Z)

The reference time depends on the row that q falls on; the fixed point is reached in a few steps because a picture
moves by far less than a row while a row is read. With `geometry="rectify"` the latent picture is the one of a global
shutter at the middle row's mid-exposure, `q = K C(mid) C(t)^T K^-1 p`, and paths hold the skew besides the blur.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog, OrientationTrack
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

Motion = Literal["rotation", "small-angle"]
MOTIONS: tuple[Motion, ...] = ("rotation", "small-angle")
Geometry = Literal["keep", "rectify"]
GEOMETRIES: tuple[Geometry, ...] = ("keep", "rectify")

# Time samples per pixel of path. Segments, not dots, are rasterised, so this only has to follow the curve.
SAMPLES_PER_PIXEL = 4

# Where every row has a path, samples a pixel apart will do: neighbouring rows' differ by more.
ROW_SAMPLES_PER_PIXEL = 1
# Rows traced at a time, which bounds the memory of the poses along their paths.
ROWS_TOGETHER = 64

# Grid on which the blur is probed. One row per millisecond of an ordinary readout, well within a gyro interval; across
# the picture the blur changes smoothly, whatever the motion.
PROBE_ROWS, PROBE_COLS = 33, 9

# Each step of the fixed point shrinks the error by (vertical speed x line time), at most about 0.1 in practice:
# three steps bring a 100 px path to 0.1 px in the worst case, and to 1e-3 px ordinarily.
FIXED_POINT_STEPS = 3


@dataclass(frozen=True, eq=False)
class Capture:
    """One exposure with the camera's motion during it; the readout runs along y.

    Built by :meth:`from_log`, which validates that the log describes the exposure.

    Parameters
    ----------
    track : OrientationTrack
        Orientation of the camera, camera time, at least from the first row's opening to the last one's closing.
    camera : Camera
        Read top-down or bottom-up; a camera with horizontal readout is :meth:`~rsdeblur.Camera.turned` first.
    exposure : Exposure
        When the rows are exposed.
    translation : Translation, optional
        Where the camera was, on the exposure's epoch; without it only rotation counts.
    motion : {"rotation", "small-angle"}
        How paths are traced: with the full homography, or with Sindelar and Sroubek (2013), eq. 6, which is for small
        angles about x and y and the same over the whole width.
    """

    track: OrientationTrack
    camera: Camera
    exposure: Exposure
    translation: Translation | None = None
    motion: Motion = "rotation"

    @classmethod
    def from_log(
        cls,
        log: GyroLog,
        camera: Camera,
        exposure: Exposure,
        translation: Translation | None = None,
        *,
        motion: Motion = "rotation",
    ) -> Capture:
        """Integrate the part of `log` that the exposure needs.

        Raises
        ------
        InputError
            If `motion` is unknown, the camera is read along x, or a translation comes with a lens that sees backwards.
        CoverageError, ClockError, GapError
            See :meth:`rsdeblur.GyroLog.covering`.
        """
        validate.choice("motion", motion, MOTIONS)
        if camera.horizontal_readout and camera.readout_time > 0:
            raise InputError(f"the camera is read {camera.readout_direction}; trace paths with camera.turned()")
        opens, closes = exposure.span(camera)
        track = OrientationTrack.from_log(log, camera, opens, closes, exposure.epoch_ns)
        if translation is not None:
            translation = translation.covering(opens, closes, exposure.epoch_ns)
            corners = np.stack(np.meshgrid([0.0, camera.width - 1], [0.0, camera.height - 1]), axis=-1)
            if not (camera.rays(corners)[..., 2] > 0).all():
                raise InputError(
                    "the lens sees 180 degrees and more, a scene of one depth does not; use no translation"
                )
        return cls(track, camera, exposure, translation, motion)

    @cached_property
    def probe(self) -> BlurPaths:
        """Few paths with few samples, spread over the whole picture: enough for their extent and change."""
        rows = np.linspace(0.0, self.camera.height - 1, PROBE_ROWS)
        cols = np.linspace(0.0, self.camera.width - 1, PROBE_COLS)
        return BlurPaths.from_capture(self, rows, cols, samples=2 * len(self.track.t) + 1)

    @cached_property
    def row_poses(self) -> RowPoses:
        """Poses of all rows of the picture, and of as many beyond it, where paths may reach."""
        rows = np.arange(2.0 * self.camera.lines) - self.camera.lines // 2
        mid = self.mid(rows)
        turned = self.track.at(mid)
        moved = -turned @ self.position(mid)[..., None]
        return RowPoses(self.camera, np.concatenate([turned, moved], axis=-1).reshape(-1, 12))

    def position(self, times: FloatArray) -> FloatArray:
        """Return where the camera is at `times`, in depths of the scene; shape `times.shape + (3,)`."""
        return np.zeros((*times.shape, 3)) if self.translation is None else self.translation.at(times)

    def points(self, pixels: FloatArray) -> FloatArray:
        """Return what `pixels` (..., 2) see, in camera axes: directions, or points in depths of the scene."""
        rays = self.camera.rays(pixels)
        return rays if self.translation is None else rays / rays[..., 2:]

    def mid(self, rows: FloatArray) -> FloatArray:
        """Return the mid-exposure times of `rows`."""
        opens, closes = self.exposure.window(rows, self.camera)
        return 0.5 * (opens + closes)

    @property
    def middle(self) -> FloatArray:
        """Mid-exposure time of the middle row, to which pictures are rectified."""
        return self.mid(np.array((self.camera.height - 1) / 2))

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
    def from_capture(
        cls,
        capture: Capture,
        rows: ArrayLike,
        cols: ArrayLike,
        *,
        geometry: Geometry = "keep",
        samples: int | Literal["auto"] = "auto",
    ) -> BlurPaths:
        """Trace the paths of the pixels at `rows` x `cols`.

        Parameters
        ----------
        capture : Capture
            The exposure, the camera's motion during it, and how to trace it.
        rows, cols : array_like, shape (B,) and (S,)
            Grid in px.
        geometry : {"keep", "rectify"}
            The latent picture: rolling like the recorded one, or at the middle row's mid-exposure.
        samples : int or "auto"
            Number of time samples, at least 2; "auto" takes at least 4 per pixel of the longest path.

        Raises
        ------
        InputError
            If an argument is out of its range.
        """
        validate.choice("geometry", geometry, GEOMETRIES)
        rows, cols = (validate.real_array(name, grid, (None,)) for name, grid in (("rows", rows), ("cols", cols)))
        trace = _rotation_paths if capture.motion == "rotation" else _small_angle_paths
        if samples == "auto":
            # Two samples per gyro interval follow every bend of the track; then refine by the length found.
            coarse = 2 * len(capture.track.t) + 1
            length = _lengths(trace(capture, rows, cols, coarse, geometry)).max()
            samples = max(coarse, int(np.ceil(SAMPLES_PER_PIXEL * length)) + 1)
        displacements = trace(capture, rows, cols, validate.count("samples", samples, minimum=2), geometry)
        displacements.setflags(write=False)
        return cls(displacements, rows, cols)

    @classmethod
    def every_row(
        cls,
        capture: Capture,
        cols: ArrayLike,
        *,
        geometry: Geometry = "keep",
        within: slice = slice(None),
    ) -> BlurPaths:
        """Trace the paths of every row of the picture, or of those `within`, at `cols`; see :meth:`from_capture`."""
        longest = float(capture.probe.lengths.max())
        samples = max(2 * len(capture.track.t) + 1, int(np.ceil(ROW_SAMPLES_PER_PIXEL * longest)) + 1)
        rows = np.arange(float(capture.camera.height))[within]
        parts = [
            cls.from_capture(capture, part, cols, geometry=geometry, samples=samples)
            for part in np.split(rows, range(ROWS_TOGETHER, len(rows), ROWS_TOGETHER))
        ]
        displacements = np.concatenate([part.displacements for part in parts])
        displacements.setflags(write=False)
        return cls(displacements, rows, parts[0].cols)

    @property
    def change_down(self) -> float:
        """Fastest change of the path from row to row, in px per height of the grid.

        Two paths differ by the largest distance between their points at equal fractions of the exposure.
        """
        steps = np.linalg.norm(np.diff(self.displacements, axis=0), axis=-1)
        return float(steps.max()) * (len(self.rows) - 1)

    @property
    def curvature_down(self) -> float:
        """How far the change of the path from row to row is from linear.

        The largest second derivative in px per squared height of the evenly spaced grid: paths interpolated linearly
        between N equal parts are wrong by about `curvature_down / (8 N^2)` px.
        """
        return self._curvature(0, len(self.rows))

    @property
    def curvature_across(self) -> float:
        """The same from column to column, per squared width of the grid."""
        return self._curvature(1, len(self.cols))

    def _curvature(self, axis: int, points: int) -> float:
        bends = np.linalg.norm(np.diff(self.displacements, n=2, axis=axis), axis=-1)
        return float(bends.max()) * (points - 1) ** 2

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


def _rotation_paths(
    capture: Capture, rows: FloatArray, cols: FloatArray, samples: int, geometry: Geometry
) -> FloatArray:
    camera = capture.camera
    points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None, :]  # (B, S, 1, 2), x before y
    seen = capture.points(points)[:, :, 0]
    times = capture.times(rows, samples)
    orientation = capture.track.at(times)  # (B, T, 3, 3)
    world = np.einsum("btji,bsj->bsti", orientation, seen) + capture.position(times)[:, None]
    if geometry == "rectify":
        return points - camera.project((world - capture.position(capture.middle)) @ capture.track.at(capture.middle).T)
    # Start at the pixel's own row, whose reference orientation is nearly right.
    q = np.broadcast_to(points, (*world.shape[:-1], 2))
    for _ in range(FIXED_POINT_STEPS if camera.readout_time > 0 else 1):
        q = capture.row_poses.project(world, q[..., 1])
    return points - q


def _small_angle_paths(
    capture: Capture, rows: FloatArray, cols: FloatArray, samples: int, geometry: Geometry
) -> FloatArray:
    reference = capture.mid(rows) if geometry == "keep" else np.repeat(capture.middle, len(rows))
    times = capture.times(rows, samples)
    angles = capture.track.angles(times) - capture.track.angles(reference)[:, None]
    moved = capture.position(times) - capture.position(reference)[:, None]
    fx, fy = capture.camera.focal_length
    # The picture moves by f (-theta_y, +theta_x), and against the camera.
    d = np.stack([-fx * (angles[..., 1] + moved[..., 0]), fy * (angles[..., 0] - moved[..., 1])], axis=-1)
    return np.repeat(d[:, None], len(cols), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RowPoses:
    """Pose of every row at its own mid-exposure, and the projection with it."""

    camera: Camera
    matrices: FloatArray  # (2 H, 12), C(mid(y)) [I | -P(mid(y))] from row -H/2 on

    def project(self, world: FloatArray, rows: FloatArray) -> FloatArray:
        """Project points (..., 3), in depths, with the poses of `rows` (..., fractions allowed).

        Linear between rows, which turn against each other by 1e-4 rad in a picture of thousands of rows.
        """
        half = len(self.matrices) // 4
        place = np.clip(rows + half, 0.0, len(self.matrices) - 1.0)
        i = np.minimum(place.astype(np.intp), len(self.matrices) - 2)
        pose = self.matrices[i] + (place - i)[..., None] * (self.matrices[i + 1] - self.matrices[i])
        pose = pose.reshape(*rows.shape, 3, 4)
        return self.camera.project(np.einsum("...ij,...j->...i", pose[..., :3], world) + pose[..., 3])
