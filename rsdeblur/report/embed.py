"""Data embedded in the page of the report: pictures and kernels as data URIs, the motion as numbers, safe JSON."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rsdeblur._util.one_line import one_line
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.psf import PsfBank
from rsdeblur.report._draw import MARKS, rgb8
from rsdeblur.report.psf_map import evenly, visible_part
from rsdeblur.types import FloatArray

# Bytes of all pictures together; base64 adds a third.
BUDGET = 9 * 2**20
# Per picture: a browser, also a phone's, needs four bytes of memory for each pixel.
MOST_PIXELS = 8_000_000
QUALITY = 92
# Most rows and columns of kernels embedded per mode: more would not fit on the picture.
MOST_KERNELS = 17, 11
# Longer side of a map of weights, px, and the share of the tint where a weight is 0.
MAP_SIDE, TINT = 400, 0.7
# Time that the plot shows before and after the exposure: this share of it, but at least this many s.
AROUND, LEAST_AROUND = 0.5, 0.02
MOST_SAMPLES = 4000


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class MotionPlot:
    """The gyroscope's rates around an exposure, and when each row was exposed.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Sample times in s after the first row opens, camera time.
    rates : ndarray, shape (n, 3)
        Rates about the camera's x, y and z axes, rad/s.
    every : int
        Spacing of the samples that are kept, in samples of the log: 1 keeps all, 2 every second.
    axis : {"y", "x"}
        Picture axis that the readout runs along.
    opens : (float, float)
        Times at which the first and the last line along that axis open, s.
    lines : int
        Number of lines.
    duration : float
        Exposure time of a line, s.
    """

    t: FloatArray
    rates: FloatArray
    every: int
    axis: str
    opens: tuple[float, float]
    lines: int
    duration: float

    @classmethod
    def of(cls, log: GyroLog, camera: Camera, exposure: Exposure) -> MotionPlot:
        """Return the part of the log around the exposure, in the camera's axes.

        Parameters
        ----------
        log : GyroLog
            The gyro log.
        camera : Camera
            Source of the readout, the axes and the time offset.
        exposure : Exposure
            The exposure.

        Returns
        -------
        MotionPlot
            At most 4000 samples.
        """
        start, end = exposure.span(camera)
        # Timestamps are subtracted as integers; only the difference becomes a float.
        t = log.t + (log.epoch_ns - exposure.epoch_ns) * 1e-9 + camera.time_offset - start
        around = max(AROUND * (end - start), LEAST_AROUND)
        near = np.flatnonzero((t >= -around) & (t <= end - start + around))
        every = math.ceil(max(len(near), 1) / MOST_SAMPLES)
        near = near[::every]
        opens, _ = exposure.window(np.array([0.0, camera.lines - 1.0]), camera)
        return cls(
            t=t[near],
            rates=log.omega[near] @ camera.imu_to_camera.T,
            every=every,
            axis="x" if camera.horizontal_readout else "y",
            opens=(float(opens[0] - start), float(opens[1] - start)),
            lines=camera.lines,
            duration=exposure.duration,
        )


def motion_data(plot: MotionPlot) -> dict[str, Any]:
    """Return the plot as data for the page, with times in ms."""
    return {
        "t": np.round(1e3 * plot.t, 4).tolist(),
        "rates": np.round(plot.rates.T, 6).tolist(),
        "every": plot.every,
        "axis": plot.axis,
        "opens": [round(1e3 * time, 4) for time in plot.opens],
        "lines": plot.lines,
        "duration": round(1e3 * plot.duration, 4),
    }


def picture_uris(pictures: Mapping[str, NDArray[np.floating]], icc_profile: bytes | None) -> tuple[list[str], float]:
    """Encode pictures of one size as JPEG, all reduced by one factor until they fit the budget.

    Returns
    -------
    uris : list of str
        Data URIs.
    scale : float
        Width and height of the encoded pictures as a share of the original; at most 1.
    """
    images = [rgb8(label, picture) for label, picture in pictures.items()]
    width, height = images[0].size
    scale = min(1.0, math.sqrt(MOST_PIXELS / (width * height)))
    while True:
        size = max(round(width * scale), 1), max(round(height * scale), 1)
        encoded = [_jpeg(image, size, icc_profile) for image in images]
        total = sum(map(len, encoded))
        if total <= BUDGET or max(size) == 1:
            return [_uri("image/jpeg", data) for data in encoded], scale
        # Smaller pictures need somewhat more bytes per pixel.
        scale *= 0.95 * math.sqrt(BUDGET / total)


def weight_map_uri(picture: NDArray[np.floating], weights: NDArray[np.floating]) -> str:
    """Encode a grey thumbnail of a picture, tinted where a frame of a burst does not count; weights are 0 to 1."""
    image = rgb8("the picture", picture)
    scale = min(1.0, MAP_SIDE / max(image.size))
    width, height = (max(round(side * scale), 1) for side in image.size)
    grey = np.asarray(image.convert("L").resize((width, height)), dtype=np.float32)[..., None]
    mask = Image.fromarray(np.asarray(weights, dtype=np.float32)).resize((width, height), Image.Resampling.BILINEAR)
    share = TINT * (1.0 - np.asarray(mask)[..., None].clip(0.0, 1.0))
    tinted = grey + share * (np.array(MARKS[0], dtype=np.float32) - grey)
    return _uri("image/jpeg", _jpeg(Image.fromarray(tinted.astype(np.uint8)), (width, height), None))


def bank_data(bank: PsfBank) -> dict[str, Any]:
    """Return an evenly spaced selection of the kernels as one grey picture, each brightened to its own peak."""
    kernels = visible_part(np.asarray(bank.kernels, dtype=np.float64))
    rows, cols = (evenly(n, most) for n, most in zip(kernels.shape[:2], MOST_KERNELS, strict=True))
    selection = kernels[np.ix_(rows, cols)]
    tall, wide = selection.shape[2:]
    # The square root makes faint parts of a trail visible.
    shown = np.sqrt(np.clip(selection / selection.max(axis=(2, 3), keepdims=True), 0.0, 1.0))
    atlas = shown.transpose(0, 2, 1, 3).reshape(len(rows) * tall, len(cols) * wide)
    buffer = BytesIO()
    Image.fromarray(np.round(255.0 * atlas).astype(np.uint8)).save(buffer, "PNG", optimize=True)
    return {
        "rows": np.round(bank.rows[rows], 2).tolist(),
        "cols": np.round(bank.cols[cols], 2).tolist(),
        "kernel": [wide, tall],
        "of": list(bank.kernels.shape[:2]),
        "atlas": _uri("image/png", buffer.getvalue()),
    }


def script_json(payload: Any) -> str:
    """Return JSON that is safe in a script element: no text in it can end the element or open a comment."""
    text = json.dumps(payload, separators=(",", ":"), allow_nan=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def _jpeg(image: Image.Image, size: tuple[int, int], icc_profile: bytes | None) -> bytes:
    resized = image if size == image.size else image.resize(size, Image.Resampling.LANCZOS)
    buffer = BytesIO()
    resized.save(buffer, "JPEG", quality=QUALITY, subsampling=0, icc_profile=icc_profile or b"")
    return buffer.getvalue()


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def telling_place(pictures: Mapping[str, NDArray[np.floating]], best: str) -> tuple[float, float]:
    """Return (x, y) of the middle of the part in which the `best` picture differs most from the first one, px.

    The part is half as wide and as high as the picture. Flat differences, as of brightness, do not count.
    """
    first, other = (
        np.asarray(picture, dtype=np.float32) for picture in (next(iter(pictures.values())), pictures[best])
    )
    height, width = first.shape[:2]
    grey = (other - first).reshape(height, width, -1).mean(axis=2)
    steps = np.pad(np.abs(np.diff(grey, axis=1)), ((0, 0), (0, 1)))
    tall, wide = max(height // 2, 1), max(width // 2, 1)
    table = np.pad(steps.cumsum(axis=0, dtype=np.float64).cumsum(axis=1), ((1, 0), (1, 0)))
    sums = table[tall:, wide:] - table[:-tall, wide:] - table[tall:, :-wide] + table[:-tall, :-wide]
    y, x = np.unravel_index(int(sums.argmax()), sums.shape)
    return float(x) + wide / 2, float(y) + tall / 2
