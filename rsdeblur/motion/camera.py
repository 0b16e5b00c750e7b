"""The camera: intrinsics and lens, rolling-shutter readout, and orientation and clock relative to the IMU."""

from __future__ import annotations

import os
import tomllib
import warnings
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.files import atomic_write, checked_path, read_file
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import (
    DISTORTIONS,
    READOUT_DIRECTIONS,
    TIMESTAMP_MARKS,
    Distortion,
    ReadoutDirection,
    TimestampMarks,
)
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.motion import camera_values as values
from rsdeblur.motion import lens
from rsdeblur.types import FloatArray

# Moments that the timestamp of a capture may mark, each as a share of the time from the start of the first row's
# exposure to the end of the last row's. Android marks the start, Gyroflow the middle row's mid-exposure.
TIMESTAMP_SHARES: dict[TimestampMarks, float] = {"start": 0.0, "middle": 0.5, "end": 1.0}

# Readout time of a camera that does not state it, and its standard deviation, s: phones' (docs/readout-times.md).
UNKNOWN_READOUT: dict[str, Any] = {"readout_time": 20e-3, "readout_sd": 10e-3}


@one_line()
@dataclass(frozen=True, slots=True, eq=False, init=False)
class Camera:
    """A camera with a rolling shutter and a rigidly mounted IMU.

    Camera axes are x right, y down, z forward in the picture as stored; pixel centres are at integer coordinates.

    Parameters
    ----------
    width, height : int
        Size of the picture in px.
    focal_length : float or (float, float)
        Focal length in px, one for both axes or (fx, fy). The attribute is always (fx, fy).
    principal_point : (float, float), optional
        Principal point (cx, cy) in px; default the picture's centre ((width - 1)/2, (height - 1)/2).
    readout_time : float, default 0.0
        Readout time in s, at least 0: the start of exposure moves by `readout_time / lines` from one sensor row to the
        next. 0 is a global shutter.
    readout_sd : float, default 0.0
        Standard deviation of `readout_time` in s where it is a guess, which :func:`rsdeblur.refine` corrects by the
        picture. 0: it is known, to within the relative error of :class:`rsdeblur.Uncertainty`.
    readout_direction : {"top-down", "bottom-up", "left-right", "right-left"}
        Direction of the readout in the picture as stored.
    imu_to_camera : array_like, shape (3, 3), or str, optional
        Rotation from IMU axes to camera axes; default identity. Its rows are the camera's axes in the IMU frame. A str
        is a preset, ``"phone-portrait"``, ``"phone-landscape"`` (rear camera, log in phone axes) or ``"gyroflow"`` (log
        in Gyroflow's axes), or an orientation string like ``"YxZ"``; see `rsdeblur.motion.axes`.
    time_offset : float, default 0.0
        `camera_time = gyro_time + time_offset`, in s.
    time_offset_sd : float, default 0.0
        Standard deviation of `time_offset` in s where it is known, such as 0.001. 0: :class:`rsdeblur.Uncertainty`.
    distortion_model : {"none", "radtan", "fisheye"}
        Model of the lens distortion, as in OpenCV; Kalibr calls ``"fisheye"`` equidistant.
    distortion : array_like, default ()
        Coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6]] of ``"radtan"``, k1, k2, k3, k4 of ``"fisheye"``.
    timestamp_marks : {"start", "middle", "end"}
        Moment that the timestamp of a capture marks: the start of exposure of the first row read, the mid-exposure of
        the middle row, or the end of exposure of the last row read.

    Raises
    ------
    InputError
        If a value is out of its range, `imu_to_camera` is not a rotation, or the distortion maps two directions to one
        pixel of the frame.

    Warns
    -----
    RsdeblurWarning
        If `focal_length` is one number that is probably in mm, or `readout_time` with it in ms.
    """

    width: int
    height: int
    focal_length: tuple[float, float]
    principal_point: tuple[float, float]
    readout_time: float
    readout_sd: float
    readout_direction: ReadoutDirection
    imu_to_camera: FloatArray
    time_offset: float
    time_offset_sd: float
    distortion_model: Distortion
    distortion: tuple[float, ...]
    timestamp_marks: TimestampMarks

    # Written by hand, because arguments may have more types than the attributes: one focal length, any array, a preset.
    def __init__(
        self,
        width: int,
        height: int,
        focal_length: float | tuple[float, float] | ArrayLike,
        principal_point: tuple[float, float] | ArrayLike | None = None,
        *,
        readout_time: float = 0.0,
        readout_sd: float = 0.0,
        readout_direction: ReadoutDirection = "top-down",
        imu_to_camera: ArrayLike | str | None = None,
        time_offset: float = 0.0,
        time_offset_sd: float = 0.0,
        distortion_model: Distortion = "none",
        distortion: ArrayLike = (),
        timestamp_marks: TimestampMarks = "start",
    ) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        put("width", values.pixels("width", width))
        put("height", values.pixels("height", height))
        put("focal_length", values.focal_length(focal_length))
        centre = ((self.width - 1) / 2, (self.height - 1) / 2) if principal_point is None else principal_point
        cx, cy = validate.real_array("principal_point", centre, (2,), most=values.LARGEST).tolist()
        put("principal_point", (cx, cy))
        seconds = {"readout_time": readout_time, "readout_sd": readout_sd, "time_offset_sd": time_offset_sd}
        for name, time in seconds.items():
            put(name, validate.finite(name, time, minimum=0.0, maximum=validate.MOST_SECONDS))
        put("readout_direction", validate.choice("readout_direction", readout_direction, READOUT_DIRECTIONS))
        put("imu_to_camera", values.rotation(np.eye(3) if imu_to_camera is None else imu_to_camera))
        put("time_offset", validate.time("time_offset", time_offset))
        put("distortion_model", validate.choice("distortion_model", distortion_model, DISTORTIONS))
        put("distortion", values.coefficients(self.distortion_model, distortion))
        put("timestamp_marks", validate.choice("timestamp_marks", timestamp_marks, TIMESTAMP_MARKS))
        self._check_distortion()
        # A camera that is derived from this one has a pair, and is not to warn again.
        for mistake in values.mistakes(self) if np.ndim(focal_length) == 0 else ():
            warnings.warn(mistake, RsdeblurWarning, stacklevel=2)

    def __eq__(self, other: object) -> bool:
        return self._values() == other._values() if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def _values(self) -> tuple[object, ...]:
        """Return the values of all fields, which compare as a whole."""
        values = (getattr(self, field.name) for field in fields(self))
        return tuple(tuple(value.flat) if isinstance(value, np.ndarray) else value for value in values)

    @property
    def matrix(self) -> FloatArray:
        """Intrinsic matrix K, shape (3, 3)."""
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def horizontal_readout(self) -> bool:
        """Whether the readout runs along the x axis of the picture."""
        return self.readout_direction in ("left-right", "right-left")

    @property
    def lines(self) -> int:
        """Number of sensor rows read out: the height, or the width for a horizontal readout."""
        return self.width if self.horizontal_readout else self.height

    def reading_order(self, rows: FloatArray) -> FloatArray:
        """Return how many sensor rows are read before each of `rows`.

        Parameters
        ----------
        rows : ndarray
            Positions along the readout axis of the picture as stored (y, or x for a horizontal readout); any shape,
            fractions allowed.
        """
        backwards = self.readout_direction in ("bottom-up", "right-left")
        rows = validate.array("rows", rows)
        return self.lines - 1 - rows if backwards else rows

    def rays(self, points: ArrayLike) -> FloatArray:
        """Return the viewing directions (..., 3) of pixels in camera axes; NaN where the lens model has none.

        Parameters
        ----------
        points : array_like, shape (..., 2)
            (x, y) in px.
        """
        points = values.vectors("points", points, 2)
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        normalised = np.stack([(points[..., 0] - cx) / fx, (points[..., 1] - cy) / fy], axis=-1)
        return lens.rays(normalised, self.distortion_model, self.distortion)

    def project(self, directions: ArrayLike) -> FloatArray:
        """Return the pixels (..., 2), (x, y), that see directions; the inverse of :meth:`rays`.

        Parameters
        ----------
        directions : array_like, shape (..., 3)
            In camera axes, of any length. Only a fisheye sees those behind the camera; others give NaN.
        """
        directions = values.vectors("directions", directions, 3)
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        points = lens.project(directions, self.distortion_model, self.distortion)
        points *= (fx, fy)
        points += (cx, cy)
        return points

    def _check_distortion(self) -> None:
        """Raise `InputError` unless each pixel of the frame sees exactly one direction."""
        if self.distortion_model == "none":
            return
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        x, y = np.linspace(0, self.width - 1, 17), np.linspace(0, self.height - 1, 17)
        farthest = 0.0
        if self.distortion_model == "fisheye":
            # Only distances along the axes count, because the model may be extrapolated in the corners.
            farthest = max(abs(x - cx).max() / fx, abs(y - cy).max() / fy)
        # A fisheye sees at most 180 degrees off its axis, and a point beyond has no direction either.
        seen = self.rays(np.stack(np.meshgrid(x, y), axis=-1))
        if farthest > lens.reach(self.distortion) or not np.isfinite(seen).all():
            raise InputError(
                f"the {self.distortion_model} distortion {self.distortion} folds the picture over itself within the "
                "frame, or the frame reaches beyond 180 degrees off the axis; check the coefficients and their order, "
                "and that focal_length and principal_point are in px of this size"
            )

    def scaled(self, s: float) -> Camera:
        """Return the camera of the picture resized by a factor; pixel centres stay at integers.

        Parameters
        ----------
        s : float
            Factor, positive; sizes are rounded to whole pixels.

        Raises
        ------
        InputError
            If `s` is not positive and finite.
        """
        s = validate.finite("s", s, above=0.0)
        return self.resized(max(round(self.width * s), 1), max(round(self.height * s), 1))

    def resized(self, width: int, height: int) -> Camera:
        """Return the camera of the picture resized to a given size; pixel centres stay at integers.

        Parameters
        ----------
        width, height : int
            New size in px.

        Raises
        ------
        InputError
            If a size is not a whole number of at least 1.
        """
        width, height = values.pixels("width", width), values.pixels("height", height)
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        # Sizes are whole pixels, so the two ratios may differ.
        sx, sy = width / self.width, height / self.height
        principal_point = ((cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5)
        return replace(
            self, width=width, height=height, focal_length=(fx * sx, fy * sy), principal_point=principal_point
        )

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera of a part of the picture.

        The readout time shrinks in proportion to the rows. `time_offset` accounts for the rows cut off before the first
        one, so an `Exposure` of the whole picture stays valid for the part; a translation needs
        :meth:`rsdeblur.Translation.cropped`.

        Parameters
        ----------
        left, top : int
            First column and row of the part in px.
        width, height : int
            Size of the part in px.

        Raises
        ------
        InputError
            If a value is not a whole number, or the part does not fit into the picture.
        """
        left, top = values.pixels("left", left, minimum=0), values.pixels("top", top, minimum=0)
        width, height = values.pixels("width", width), values.pixels("height", height)
        if left + width > self.width or top + height > self.height:
            raise InputError(
                f"the cut-out {width}x{height} at ({left}, {top}) does not fit the picture, {self.width}x{self.height}"
            )
        first, size = (left, width) if self.horizontal_readout else (top, height)
        skipped = self.reading_order(np.array([first, first + size - 1], dtype=np.float64)).min()
        cx, cy = self.principal_point
        # A timestamp of the middle or the end is that of the whole picture.
        later = TIMESTAMP_SHARES[self.timestamp_marks] * (self.lines - size) - float(skipped)
        return replace(
            self,
            width=width,
            height=height,
            principal_point=(cx - left, cy - top),
            readout_time=self.readout_time * size / self.lines,
            readout_sd=self.readout_sd * size / self.lines,
            time_offset=self.time_offset + self.readout_time * later / self.lines,
        )

    def turned(self) -> Camera:
        """Return the camera of the picture turned a quarter clockwise (`numpy.rot90(picture, -1)`).

        A horizontal readout becomes a vertical one. A turn keeps the handedness of the axes; a transposition would
        not.
        """
        (fx, fy), (cx, cy) = self.focal_length, self.principal_point
        # The new x axis is the old -y axis, the new y axis the old x axis.
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        turned: tuple[ReadoutDirection, ...] = ("right-left", "left-right", "top-down", "bottom-up")
        return replace(
            self,
            width=self.height,
            height=self.width,
            focal_length=(fy, fx),
            principal_point=(self.height - 1 - cy, cx),
            readout_direction=turned[READOUT_DIRECTIONS.index(self.readout_direction)],
            imu_to_camera=quarter @ self.imu_to_camera,
            distortion=lens.turned(self.distortion_model, self.distortion),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the camera as TOML (see ``docs/camera-file.md``); the file is replaced atomically.

        Parameters
        ----------
        path : path-like
            The file.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        table = {f.name: getattr(self, f.name) for f in fields(self)} | {"imu_to_camera": self.imu_to_camera.tolist()}
        with atomic_write(path) as file:
            file.write(b"# rsdeblur camera: px, s; camera axes x right, y down, z forward\n")
            file.write(tomlkit.dumps(table).encode())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Camera:
        """Read a camera from TOML.

        Parameters
        ----------
        path : path-like
            A file written by :meth:`save`, or by hand; all keys except `width`, `height` and `focal_length` are
            optional. Without `readout_time` it is that of a phone, 20 ms, with a `readout_sd` of 10 ms.

        Raises
        ------
        FileFormatError
            If the file cannot be read, is not TOML, lacks `width`, `height` or `focal_length`, has an unknown key, or
            a value is out of its range.
        """
        path = checked_path(path)
        try:
            # A ValueError also where an integer has thousands of digits.
            table = tomllib.loads(read_file(path, "camera file").decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise FileFormatError(f"{path}: not a TOML camera file: {error}") from error
        known = [f.name for f in fields(cls)]
        for key in table:
            if key not in known:
                close = get_close_matches(key, known, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"known keys are {', '.join(known)}"
                raise FileFormatError(f"{path}: unknown key {key!r}; {hint}")
        missing = [key for key in ("width", "height", "focal_length") if key not in table]
        if missing:
            raise FileFormatError(f"{path}: the camera file lacks {', '.join(missing)}")
        try:
            return cls(**(table if "readout_time" in table else UNKNOWN_READOUT | table))
        except InputError as error:
            raise FileFormatError(f"{path}: {error}") from error
