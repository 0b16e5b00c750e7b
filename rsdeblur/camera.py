"""The camera: intrinsics, rolling-shutter readout, and its relation to the IMU in space and time."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import tomli_w
from numpy.typing import ArrayLike

from rsdeblur import _validate
from rsdeblur._atomic import atomic_write
from rsdeblur._validate import FloatArray
from rsdeblur.errors import FileFormatError, InputError

ReadoutDirection = Literal["top-down", "bottom-up", "left-right", "right-left"]
READOUT_DIRECTIONS: tuple[ReadoutDirection, ...] = ("top-down", "bottom-up", "left-right", "right-left")

# A rotation typed with four decimals is orthonormal to 1e-4; anything worse is not a rotation.
ROTATION_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera with a rolling shutter and a rigidly mounted IMU.

    Camera axes are x right, y down, z forward in the picture as stored; pixel centres are at integer coordinates.

    Parameters
    ----------
    width, height : int
        Size of the picture in px.
    focal : float or (float, float)
        Focal length in px, one or (fx, fy). Kept as (fx, fy).
    principal : (float, float), optional
        Principal point (cx, cy) in px; default the picture's centre ((width - 1)/2, (height - 1)/2).
    readout : float, default 0.0
        Readout time in s: from the first row's start of exposure to one row past the last row's. 0 is a global shutter.
    readout_direction : {"top-down", "bottom-up", "left-right", "right-left"}
        How the readout runs over the picture as stored.
    imu_to_camera : array_like, shape (3, 3), optional
        Rotation that takes IMU axes to camera axes; default identity. Its rows are the camera's axes in the IMU frame.
    time_offset : float, default 0.0
        `camera_time = gyro_time + time_offset`, in s.

    Raises
    ------
    InputError
        If a value is impossible, or `imu_to_camera` is not a rotation.
    """

    width: int
    height: int
    focal: tuple[float, float]
    principal: tuple[float, float] = cast("tuple[float, float]", None)
    readout: float = field(default=0.0, kw_only=True)
    readout_direction: ReadoutDirection = field(default="top-down", kw_only=True)
    imu_to_camera: FloatArray = field(default=cast(FloatArray, None), kw_only=True)
    time_offset: float = field(default=0.0, kw_only=True)

    # The public signature takes one focal length, any pair and no principal point; the attributes are always whole.
    def __init__(
        self,
        width: int,
        height: int,
        focal: float | tuple[float, float] | ArrayLike,
        principal: tuple[float, float] | ArrayLike | None = None,
        *,
        readout: float = 0.0,
        readout_direction: ReadoutDirection = "top-down",
        imu_to_camera: ArrayLike | None = None,
        time_offset: float = 0.0,
    ) -> None:
        def put(name: str, value: object) -> None:
            object.__setattr__(self, name, value)

        put("width", _validate.count("width", width))
        put("height", _validate.count("height", height))
        put("focal", _focal(focal))
        if principal is None:
            principal = ((self.width - 1) / 2, (self.height - 1) / 2)
        put("principal", tuple(map(float, _validate.real_array("principal", principal, (2,)))))
        put("readout", _validate.finite("readout", readout, minimum=0.0))
        put("readout_direction", _validate.choice("readout_direction", readout_direction, READOUT_DIRECTIONS))
        put("imu_to_camera", _rotation(np.eye(3) if imu_to_camera is None else imu_to_camera))
        put("time_offset", _validate.finite("time_offset", time_offset))

    @property
    def matrix(self) -> FloatArray:
        """Intrinsic matrix K, shape (3, 3)."""
        (fx, fy), (cx, cy) = self.focal, self.principal
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def horizontal_readout(self) -> bool:
        """Whether the readout runs along the picture's x axis."""
        return self.readout_direction in ("left-right", "right-left")

    @property
    def lines(self) -> int:
        """Number of sensor rows read out: the height, or the width for a horizontal readout."""
        return self.width if self.horizontal_readout else self.height

    def reading_order(self, rows: FloatArray) -> FloatArray:
        """Return how many rows are read before each of `rows`, counted along the readout axis of the picture."""
        backwards = self.readout_direction in ("bottom-up", "right-left")
        return self.lines - 1 - rows if backwards else rows

    def scaled(self, s: float) -> Camera:
        """Return the camera of the picture resized by the factor `s`; pixel centres stay at integers."""
        s = _validate.finite("s", s, above=0.0)
        (fx, fy), (cx, cy) = self.focal, self.principal
        width, height = max(round(self.width * s), 1), max(round(self.height * s), 1)
        # Sizes are whole pixels, so each axis follows its own ratio.
        sx, sy = width / self.width, height / self.height
        principal = ((cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5)
        return self._with(width=width, height=height, focal=(fx * sx, fy * sy), principal=principal)

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera of the picture cut out at (`left`, `top`) with the given size in px.

        The readout shrinks with the rows that are left. The rows cut off before the first one are accounted for in
        `time_offset`, so an `Exposure` of the whole picture stays valid for the cut-out.
        """
        left, top = _validate.count("left", left, minimum=0), _validate.count("top", top, minimum=0)
        width, height = _validate.count("width", width), _validate.count("height", height)
        if left + width > self.width or top + height > self.height:
            raise InputError(
                f"the cut-out {width}x{height} at ({left}, {top}) does not fit the picture, {self.width}x{self.height}"
            )
        first, size = (left, width) if self.horizontal_readout else (top, height)
        skipped = self.reading_order(np.array([first, first + size - 1], dtype=np.float64)).min()
        cx, cy = self.principal
        return self._with(
            width=width,
            height=height,
            principal=(cx - left, cy - top),
            readout=self.readout * size / self.lines,
            time_offset=self.time_offset - self.readout * float(skipped) / self.lines,
        )

    def turned(self) -> Camera:
        """Return the camera of the picture turned a quarter clockwise (`numpy.rot90(picture, -1)`).

        A horizontal readout becomes a vertical one; being a rotation, it keeps the handedness of the axes, which a
        transposition would not.
        """
        (fx, fy), (cx, cy) = self.focal, self.principal
        # New x runs against the old y, new y along the old x.
        quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        turn: dict[ReadoutDirection, ReadoutDirection] = {
            "left-right": "top-down",
            "right-left": "bottom-up",
            "top-down": "right-left",
            "bottom-up": "left-right",
        }
        return self._with(
            width=self.height,
            height=self.width,
            focal=(fy, fx),
            principal=(self.height - 1 - cy, cx),
            readout_direction=turn[self.readout_direction],
            imu_to_camera=quarter @ self.imu_to_camera,
        )

    def _with(self, **changes: Any) -> Camera:
        return replace(self, **changes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the camera as TOML (see ``docs/camera-file.md``); the file is replaced atomically.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        table: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        table |= {
            "focal": list(self.focal),
            "principal": list(self.principal),
            "imu_to_camera": self.imu_to_camera.tolist(),
        }
        with atomic_write(path) as file:
            file.write(b"# rsdeblur camera: px, s; camera axes x right, y down, z forward\n")
            tomli_w.dump(table, file)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Camera:
        """Read a camera from TOML.

        Raises
        ------
        FileFormatError
            If the file cannot be read, is not TOML, lacks `width`, `height` or `focal`, has an unknown key, or a
            value is impossible.
        """
        try:
            table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise FileFormatError(f"{path}: cannot read the camera file: {error.strerror or error}") from error
        except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise FileFormatError(f"{path}: not a TOML camera file: {error}") from error
        known = [f.name for f in fields(cls)]
        for key in table:
            if key not in known:
                close = get_close_matches(key, known, n=1)
                hint = f"did you mean {close[0]!r}?" if close else f"known keys are {', '.join(known)}"
                raise FileFormatError(f"{path}: unknown key {key!r}; {hint}")
        missing = [key for key in ("width", "height", "focal") if key not in table]
        if missing:
            raise FileFormatError(f"{path}: the camera file lacks {', '.join(missing)}")
        try:
            return cls(**table)
        except InputError as error:
            raise FileFormatError(f"{path}: {error}") from error


def _focal(value: Any) -> tuple[float, float]:
    pair: Any = (value, value) if isinstance(value, (int, float, np.number)) else value
    fx, fy = _validate.real_array("focal", pair, (2,))
    if min(fx, fy) <= 0:
        raise InputError(f"focal must be positive px, got ({fx:g}, {fy:g})")
    return float(fx), float(fy)


def _rotation(value: ArrayLike) -> FloatArray:
    matrix = _validate.real_array("imu_to_camera", value, (3, 3))
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise InputError(
            f"imu_to_camera must be a rotation: its rows must be perpendicular unit vectors, got {matrix.tolist()}"
        )
    if np.linalg.det(matrix) < 0:
        raise InputError(
            "imu_to_camera has determinant -1: it mirrors the axes instead of turning them, and rates, being "
            "right-handed, would change sign. An exchange of two axes needs one more sign: turn the sign of the row "
            "whose direction was guessed, so that the determinant is +1"
        )
    return matrix
