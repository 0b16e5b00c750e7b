"""From orientation to blur: the path that each part of the picture traces while it is exposed.

The blurred picture g is a mean over time of the latent picture u: `g(p) = mean_t u(q(t))`, where t runs over the
exposure window of pixel p. The latent picture is a sharp rolling-shutter picture, each row of which shows the scene at
the mid-exposure of that row. So q(t) is the position *in that picture* of the point that p sees at time t:

    q = K C(mid(q_y)) C(t)^T K^-1 p,

where K is the projection of the camera, with its lens distortion, and C(t) its orientation. With a
:class:`~rsdeblur.Translation`, `(P(t) - P(mid(q_y))) / Z` is added to the direction `C(t)^T K^-1 p`, for the position
P(t) of the camera and the depth Z of the point (Sindelar and Sroubek 2013, eq. 3). The reference time depends on the
row that q falls on: fixed-point iteration finds it in a few steps, because a picture moves by far less than a row while
a row is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import once
from rsdeblur.choices import MOTIONS, Motion
from rsdeblur.errors import InputError
from rsdeblur.kernels.poses import pinhole_paths, row_directions
from rsdeblur.motion.arguments import check_recording, check_traceable
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.camera_values import MOST_PIXELS
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.track import OrientationTrack
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Time samples per pixel of path. Rasterisation draws segments between them, so they need to follow the curve only.
SAMPLES_PER_PIXEL = 4
# The same where every row has a path: samples may be a pixel apart, because paths of neighbouring rows differ by more.
ROW_SAMPLES_PER_PIXEL = 1
# Rows traced at a time, which bounds the memory for the poses along their paths.
ROWS_TOGETHER = 64
# Most points of paths traced at a time: 2.4 GB of poses.
MOST_POINTS = 6_000_000
# Steps of the fixed-point iteration. Each multiplies the error by (vertical speed x line time), at most about 0.1 in
# practice: after three, a path of 100 px is right to 0.1 px in the worst case and usually to 1e-3 px.
FIXED_POINT_STEPS = 3


@one_line()
@dataclass(frozen=True, eq=False)
class Capture:
    """One exposure with the motion of the camera during it; the readout runs along y.

    Use :meth:`from_log` to make one; it checks that the log covers the exposure.

    Parameters
    ----------
    track : OrientationTrack
        Orientation of the camera in camera time, at least from the start of the first row's exposure to the end of the
        last one's.
    camera : Camera
        Camera with readout top-down or bottom-up. Turn a camera with horizontal readout first, see
        :meth:`rsdeblur.Camera.turned`.
    exposure : Exposure
        Exposure times of the rows.
    translation : Translation, optional
        Positions of the camera, relative to the exposure's epoch; without them, the camera only rotates.
    motion : {"rotation", "small-angle"}
        Model of the paths: the full homography; or Sindelar and Sroubek (2013), eq. 6, for small angles about x and y,
        with paths that are the same over the whole width.
    softness : float, default 0.0
        Standard deviation in px, from 0 to 1, of the Gaussian by which lens, pixels and demosaicing blur the picture
        besides the motion.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(640, 480, 500.0)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> rsdeblur.motion.BlurPaths.from_capture(capture, rows=[100, 300], cols=[320]).lengths.shape
    (2, 1)
    """

    track: OrientationTrack
    camera: Camera
    exposure: Exposure
    translation: Translation | None = None
    motion: Motion = "rotation"
    softness: float = 0.0

    @staticmethod
    def from_log(
        log: GyroLog,
        camera: Camera,
        exposure: Exposure,
        translation: Translation | None = None,
        *,
        motion: Motion = "rotation",
        softness: float = 0.0,
    ) -> Capture:
        """Return the capture, with the orientation integrated from a gyro log.

        Parameters
        ----------
        log : GyroLog
            Rates that cover the exposure.
        camera, exposure, translation, motion, softness
            See :class:`Capture`.

        Raises
        ------
        InputError
            If `motion` or `softness` is out of range, the readout runs along x, or there is a translation but the lens
            sees 180 degrees or more.
        CoverageError, ClockError, GapError
            If the log or the translation does not describe the exposure, see :meth:`rsdeblur.GyroLog.covering`.
        """
        check_recording(log, camera, exposure, translation)
        validate.choice("motion", motion, MOTIONS)
        softness = validate.softness("softness", softness)
        return burst_captures(log, camera, [exposure], translation, motion=motion, softness=softness)[0]

    @once
    def probe(self) -> BlurPaths:
        """Few paths with few samples, spread over the whole picture: enough for the extent and change of all paths."""
        # The rows are about a millisecond apart in an ordinary readout, well within a gyro interval; across the picture
        # the blur changes smoothly for any motion.
        rows = np.linspace(0.0, self.camera.height - 1, 33)
        cols = np.linspace(0.0, self.camera.width - 1, 9)
        return BlurPaths.from_capture(self, rows, cols, samples=2 * len(self.track.t) + 1)

    @property
    def mean_length(self) -> float:
        """Mean length of the paths over the whole picture, px."""
        return float(self.probe.lengths.mean())

    @once
    def row_poses(self) -> FloatArray:
        """Poses C [I | -P] at the mid-exposures of the rows from -H/2 on (2 H, 12); paths may leave the picture."""
        rows = np.arange(2.0 * self.camera.lines) - self.camera.lines // 2
        mid = self.mid(rows)
        rotations = self.track.at(mid)
        shifts = -rotations @ self.position(mid)[..., None]
        return np.concatenate([rotations, shifts], axis=-1).reshape(-1, 12)

    def position(self, times: FloatArray) -> FloatArray:
        """Return positions of the camera in units of the scene's depth, of a map its median; 0 without a translation.

        Parameters
        ----------
        times : ndarray
            Times in s relative to the exposure's epoch; any shape. The positions have the shape ``times.shape + (3,)``.
        """
        return np.zeros((*times.shape, 3)) if self.translation is None else self.translation.at(times)

    def points(self, pixels: FloatArray) -> FloatArray:
        """Return the scene points (..., 3) that pixels see, in camera axes; without a translation, only directions.

        Parameters
        ----------
        pixels : ndarray, shape (..., 2)
            (x, y) in px. The points are in the units of :meth:`position`.
        """
        rays = self.camera.rays(pixels)
        return rays if self.translation is None else self.depth(pixels)[..., None] * rays / rays[..., 2:]

    def depth(self, pixels: FloatArray) -> FloatArray:
        """Return the depth (...) of the scene that pixels see; 1 without a translation.

        Parameters
        ----------
        pixels : ndarray, shape (..., 2)
            (x, y) in px. The depth is in the units of :meth:`position`.
        """
        if self.translation is None:
            return np.ones(pixels.shape[:-1])
        last = np.maximum(np.array([self.camera.width, self.camera.height]) - 1.0, 1.0)
        return self.translation.relative_depth(*np.moveaxis(pixels / last, -1, 0))

    def mid(self, rows: FloatArray) -> FloatArray:
        """Return the mid-exposure times of rows, in s relative to the exposure's epoch.

        Parameters
        ----------
        rows : ndarray
            Picture rows in px, fractions allowed; any shape.
        """
        opens, closes = self.exposure.window(rows, self.camera)
        return 0.5 * (opens + closes)

    @property
    def middle(self) -> FloatArray:
        """Mid-exposure time of the middle row, the reference time of rectified pictures."""
        return self.mid(np.array((self.camera.height - 1) / 2))


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
    within each exposure; frames are aligned by the full rotation. Errors are those of :meth:`Capture.from_log`.
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
        Capture(track.during(*span), camera, e, translation, motion, softness)
        for e, span in zip(moved, spans, strict=True)
    ]


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class BlurPaths:
    """Displacement paths of pixels on a grid of rows x columns of the picture.

    Parameters
    ----------
    displacements : ndarray, shape (B, S, T, 2)
        Displacements `d = p - q` as (x, y) in px, at T times spread evenly over the exposure of the grid point.
    rows : ndarray, shape (B,)
        Picture rows of the grid in px.
    cols : ndarray, shape (S,)
        Picture columns of the grid in px.
    softness : float, default 0.0
        Standard deviation in px, from 0 to 1, of a Gaussian by which the picture is blurred besides the motion.
    """

    displacements: FloatArray
    rows: FloatArray
    cols: FloatArray
    softness: float = 0.0

    def __post_init__(self) -> None:
        # A view, so that the caller's own array stays writable.
        values = validate.array("displacements", self.displacements).astype(np.float64, copy=False).view()
        values.flags.writeable = False
        object.__setattr__(self, "displacements", values)
        for name in ("rows", "cols"):
            object.__setattr__(self, name, validate.real_array(name, getattr(self, name), (None,)))
        object.__setattr__(self, "softness", validate.softness("softness", self.softness))
        paths, grid = self.displacements, (*self.rows.shape, *self.cols.shape)
        if paths.ndim != 4 or paths.shape[:2] != grid or paths.shape[2] < 2 or paths.shape[3] != 2:
            raise InputError(
                f"displacements must have shape (B, S, T, 2) for B rows, S cols and T >= 2 times, got {paths.shape} "
                f"for a grid of shape {grid}"
            )
        # False for NaN, where the motion leads out of what the lens shows.
        if paths.size and not (paths.min() >= -MOST_PIXELS and paths.max() <= MOST_PIXELS):
            raise InputError(
                f"the paths reach {np.abs(paths).max():.3g} px, further than any picture, or are not finite; are the "
                "rates in rad/s, the focal length in px and the exposure in s?"
            )

    @classmethod
    def from_capture(
        cls,
        capture: Capture,
        rows: ArrayLike,
        cols: ArrayLike,
        *,
        samples: int | Literal["auto"] = "auto",
        reference: Capture | None = None,
    ) -> BlurPaths:
        """Return the paths of the pixels at `rows` x `cols`.

        Parameters
        ----------
        capture : Capture
            The exposure and the motion of the camera during it.
        rows, cols : array_like, shape (B,) and (S,)
            Grid in px.
        samples : int or "auto"
            Number of time samples, at least 2; "auto" takes at least 4 per pixel of the longest path and 2 per gyro
            interval.
        reference : Capture, optional
            Capture of the same recording whose picture the grid belongs to, see `rsdeblur.motion.alignment`;
            default `capture` itself.
        """
        validate.instance("capture", capture, Capture)
        rows, cols = (validate.real_array(name, grid, (None,)) for name, grid in (("rows", rows), ("cols", cols)))
        if not (rows.size and cols.size):
            raise InputError(f"rows and cols must not be empty, got {rows.size} and {cols.size}")
        reference = capture if reference is None else reference
        if validate.is_auto(samples):
            # The lengths of a few samples' paths give the final number.
            coarse = cls.from_capture(capture, rows, cols, samples=enough_samples(capture, 0.0), reference=reference)
            samples = enough_samples(capture, SAMPLES_PER_PIXEL * float(coarse.lengths.max()))
            if coarse.displacements.shape[2] == samples:
                return coarse
        samples = validate.count("samples", samples, minimum=2, maximum=MOST_POINTS)
        if (points := len(rows) * len(cols) * samples) > MOST_POINTS:
            raise InputError(
                f"paths at {len(rows)} x {len(cols)} places have {points} points, more than {MOST_POINTS}; are the "
                "duration of the exposure and the readout time in s?"
            )
        return cls(_traced(capture, reference, rows, cols, samples), rows, cols, capture.softness)

    @classmethod
    def every_row(cls, capture: Capture, cols: ArrayLike, *, within: slice = slice(None)) -> BlurPaths:
        """Return the paths of every row of the picture.

        Parameters
        ----------
        capture : Capture
            The exposure and the motion of the camera during it.
        cols : array_like, shape (S,)
            Columns in px.
        within : slice, optional
            Only these rows.

        Returns
        -------
        BlurPaths
            With at least one time sample per pixel of the longest path.
        """
        validate.instance("capture", capture, Capture)
        validate.instance("within", within, slice)
        cols = validate.real_array("cols", cols, (None,))
        samples = enough_samples(capture, ROW_SAMPLES_PER_PIXEL * float(capture.probe.lengths.max()))
        rows = np.arange(float(capture.camera.height))[within]
        points, pixels = len(rows) * len(cols) * samples, capture.camera.height * capture.camera.width
        validate.memory(f"paths of {points} points", 16 * points, pixels)
        return cls(traced_in_parts(capture, capture, rows, cols, samples), rows, cols, capture.softness)

    @property
    def lengths(self) -> FloatArray:
        """Length of each path in px, shape (B, S)."""
        lengths: FloatArray = np.linalg.norm(np.diff(self.displacements, axis=2), axis=-1).sum(axis=2)
        return lengths

    @property
    def extent(self) -> tuple[float, float]:
        """Largest displacement along y and along x in px, with three standard deviations of the softness."""
        # One component at a time: maxima over all axes but a short one take ten times as long.
        dx, dy = (max(float(part.max()), -float(part.min())) for part in np.moveaxis(self.displacements, -1, 0))
        return dy + 3 * self.softness, dx + 3 * self.softness


def enough_samples(capture: Capture, along_path: float) -> int:
    """Return a number of time samples: two per gyro interval, to follow every bend, and this many along a path."""
    return max(2 * len(capture.track.t), int(np.ceil(along_path))) + 1


def traced_in_parts(
    capture: Capture, reference: Capture, rows: FloatArray, cols: FloatArray, samples: int
) -> FloatArray:
    """Return the displacements of :meth:`BlurPaths.from_capture`, traced a few rows at a time."""
    parts = np.split(rows, range(ROWS_TOGETHER, len(rows), ROWS_TOGETHER))
    paths = [BlurPaths.from_capture(capture, part, cols, samples=samples, reference=reference) for part in parts]
    return np.concatenate([part.displacements for part in paths])


def shown_at(capture: Capture, world: FloatArray, guess: FloatArray, steps: int) -> FloatArray:
    """Return the pixels (x, y), (..., 2), at which points `world` (..., 3) appear, each by the pose of its row.

    Points are directions in world axes, or places in units of the scene's depth. The fixed-point iteration begins at
    the rows of a `guess`. Poses are interpolated linearly between rows, from one of which to the next they differ by at
    most 1e-4 rad in a picture of thousands of rows.
    """
    pixels = np.broadcast_to(guess, (*world.shape[:-1], 2))
    for _ in range(steps if capture.camera.readout_time > 0 else 1):
        # A point that the lens does not show has no row: any pose will do, as its position stays NaN.
        pixels = capture.camera.project(row_directions(world, pixels[..., 1], capture.row_poses))
    return pixels


def places(capture: Capture, reference: Capture, points: FloatArray) -> FloatArray:
    """Return where a capture shows what a reference shows at `points` (..., 2), both at mid-exposure.

    Places are (x, y) in px; they are NaN where the lens of the capture does not show the point.
    """
    if capture is reference:
        return points
    mid = reference.mid(points[..., 1])
    world = np.einsum("...ji,...j->...i", reference.track.at(mid), reference.points(points)) + reference.position(mid)
    # Rows of a point may be hundreds apart, which takes some steps more than within a frame.
    return shown_at(capture, world, points, FIXED_POINT_STEPS + 3)


def _traced(capture: Capture, reference: Capture, rows: FloatArray, cols: FloatArray, samples: int) -> FloatArray:
    camera, points = capture.camera, np.stack(np.meshgrid(cols, rows), axis=-1)  # (B, S, 2), x before y
    pixels = places(capture, reference, points)
    # All pixels of a row of the capture itself have one time.
    lines = rows[:, None] if capture is reference else pixels[..., 1]
    opens, closes = capture.exposure.window(lines, camera)
    times = opens[..., None] + (closes - opens)[..., None] * np.linspace(0.0, 1.0, samples)
    if capture.motion == "small-angle":
        # Sindelar and Sroubek (2013), eq. 6: the picture moves by f (-theta_y, +theta_x), and against the translation.
        mid, depth = capture.mid(lines), capture.depth(pixels)[..., None, None]
        angles = capture.track.angles(times) - capture.track.angles(mid)[..., None, :]
        shifts = capture.position(times) - capture.position(mid)[..., None, :]
        turns = np.stack([-angles[..., 1], angles[..., 0]], axis=-1)
        return (turns - shifts[..., :2] / depth) * camera.focal_length
    scene, orientation, position = capture.points(pixels), capture.track.at(times), capture.position(times)
    # The place of the pixel itself is nearly right: a path is short.
    if capture is reference and camera.distortion_model == "none":
        pinhole = *camera.focal_length, *camera.principal_point
        steps = FIXED_POINT_STEPS if camera.readout_time > 0 else 1
        poses = orientation[:, 0], position[:, 0]
        return pinhole_paths(*poses, scene, rows, cols, capture.row_poses, pinhole, steps)
    world = np.einsum("bstji,bsj->bsti", orientation, scene) + position
    return points[:, :, None] - shown_at(reference, world, points[:, :, None], FIXED_POINT_STEPS)
