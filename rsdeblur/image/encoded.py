"""Encoded pictures, as files store them, and their rows as linear light: the way into `deblur` and out of it.

Everything is computed in the upright frame, in which the picture is turned so that its readout runs along y.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.threads import share
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.image.transfer import as_float, as_stored, from_linear, resolve_transfer, to_linear
from rsdeblur.kernels.tone import look_up, to_srgb
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.motion.translation import Translation
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

# Rows converted or changed at a time, which bounds the memory: a conversion takes several arrays of that size.
ROWS = 64
# Number of different values between black and white that drawings do not have.
LEAST_LEVELS = 16


@dataclass(frozen=True, slots=True)
class EncodedImage:
    """A picture whose readout runs along y: encoded values and their tone curve."""

    # Shape (H, W, C) with C from 1 to 4, the last channel of 2 or 4 being alpha; uint8, uint16 or float. The range of
    # integers represents [0, 1].
    values: NDArray[Any]
    transfer: Transfer

    @classmethod
    def of(
        cls, image: ArrayLike, transfer: Transfer | Auto = "auto", frame: ReadoutFrame | None = None
    ) -> EncodedImage:
        """Check a picture as stored, and take it into the upright frame, if one is given, without a copy.

        A transfer of "auto" is sRGB for integers and linear for floats; a warning says if these are probably encoded.
        """
        array = validate.array("image", image)
        if array.ndim not in (2, 3) or array.size == 0 or (array.ndim == 3 and array.shape[2] > 4):
            raise InputError(f"image must have shape (H, W) or (H, W, C) with C from 1 to 4, got {array.shape}")
        if not array.dtype.isnative:
            array = array.astype(array.dtype.newbyteorder("="))
        if array.dtype not in (np.uint8, np.uint16) and not np.issubdtype(array.dtype, np.floating):
            raise InputError(f"image must be uint8, uint16 or float, got {array.dtype}")
        if validate.is_auto(transfer):
            warn_of_encoded_floats(array)
        array = array if array.ndim == 3 else array[:, :, None]
        return cls(frame.image(array) if frame else array, resolve_transfer(transfer, array.dtype))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the picture without alpha."""
        height, width, channels = self.values.shape
        return height, width, channels - (channels in (2, 4))

    def linear(self, rows: slice, *, threads: int | None = 1) -> NDArray[np.float32]:
        """Return linear light of `rows`, without alpha; refuse what is not finite or beyond 1e12."""
        height, width, channels = self.shape
        rows = slice(*rows.indices(height)[:2])
        light = empty((rows.stop - rows.start, width, channels), np.float32)
        light_of = _lookup(self.values.dtype.itemsize, self.transfer) if self.values.dtype.kind == "u" else None
        parts = list(blocks(rows))

        def decode(_: int, n: int) -> None:
            here, there = parts[n]
            if light_of is not None:
                look_up(light_of, self.values[there, :, :channels], light[here])
            else:
                light[here] = to_linear(as_float(self.values[there, :, :channels]), self.transfer)
                validate.bounded("image", light[here])
                if channels < self.values.shape[2]:
                    validate.bounded("alpha of image", self.values[there, :, channels])

        # Of several errors, the first one is raised with any number of threads.
        share(decode, range(len(parts)), 1 if light_of is None else threads)
        return light

    def grey(self, rows: slice) -> NDArray[np.float32]:
        """Return the mean linear light of the channels of `rows`, without alpha; errors as :meth:`linear`."""
        height, width, channels = self.shape
        rows = slice(*rows.indices(height)[:2])
        light = np.empty((rows.stop - rows.start, width), dtype=np.float32)
        weights = np.full(channels, 1 / channels, dtype=np.float32)
        for here, there in blocks(rows):
            # np.mean over three values takes thirty times as long.
            np.matmul(self.linear(there), weights, out=light[here])
        return light

    def encode(self, light: NDArray[np.float32], rows: slice, out: NDArray[Any], *, threads: int | None = None) -> None:
        """Encode `light` into `rows` of `out`, which is upright like the picture, and copy alpha.

        Both are clipped to [0, 1] if the picture or `out` has integers, and rounded if `out` has.
        """
        channels = light.shape[2]
        clip = self.values.dtype.kind == "u" or out.dtype.kind == "u"
        parts = list(blocks(rows))

        def encode_block(_: int, n: int) -> None:
            here, there = parts[n]
            sharp, is_finite = _stored(light[here], self.transfer, clip, out.dtype)
            if not is_finite:
                raise InputError(
                    "the result is not finite: the picture or the strengths (nsr, weight) are beyond what float32 "
                    "carries; scale the picture so that white is 1, or use larger strengths"
                )
            out[there, :, :channels] = sharp
            if channels < out.shape[2]:
                alpha = as_float(self.values[there, :, channels:])
                out[there, :, channels:] = as_stored(alpha.clip(0.0, 1.0) if clip else alpha, out.dtype)

        share(encode_block, range(len(parts)), threads)


def result_like(
    image: ArrayLike, out: NDArray[Any] | None, frame: ReadoutFrame | None = None
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the array for the result, `out` or new float32, and its view (H, W, C), upright if `frame` is.

    `InputError` is raised if `out` is not a writable array of the picture's shape and of float32, uint8 or uint16, or
    has integers where most values of the picture are floats beyond 1, which would all become white.
    """
    image = np.asarray(image)
    out = validate.output(out, image.shape, (np.float32, np.uint8, np.uint16))
    if np.may_share_memory(out, image):
        raise InputError("out must not overlap image")
    if out.dtype.kind == "u":
        validate.not_beyond_white(image, "use out of float32")
    channelled = out if out.ndim == 3 else out[:, :, None]
    return out, frame.image(channelled) if frame else channelled


def check_size(shape: tuple[int, ...], camera: Camera) -> None:
    """Raise `InputError` unless a picture of `shape` has the camera's size."""
    height, width = shape[:2]
    if (height, width) != (camera.height, camera.width):
        raise InputError(
            f"the picture is {width}x{height} px but the camera's is {camera.width}x{camera.height} px; change the "
            "camera as the picture was: rsdeblur camera import CAMERA -o OUT with --size WIDTHxHEIGHT, --crop "
            "WIDTHxHEIGHT+LEFT+TOP or --turn 1, in Python camera.resized(), cropped() or turned()"
        )


def displayed(image: ArrayLike, transfer: Transfer | Auto) -> FloatArray:
    """Return a picture as sRGB values in [0, 1], (H, W) or (H, W, 3), without alpha."""
    light = EncodedImage.of(image, transfer).linear(slice(None))
    values: FloatArray = from_linear(light, "srgb").clip(0.0, 1.0).astype(np.float64)
    return values[..., 0] if values.shape[2] == 1 else values


def reduced(image: ArrayLike, camera: Camera, side: int) -> tuple[NDArray[np.float32], Camera]:
    """Return a picture reduced until its longer side has `side` px, as float32, integers in [0, 1], and its camera.

    A smaller picture keeps its size. Sindelar and Sroubek (2013) reduce pictures of 3264x2448 to 2048x1536.
    """
    values = as_float(EncodedImage.of(image, "linear").values)
    check_size(values.shape, camera)
    scale = validate.count("side", side) / max(values.shape[:2])
    if scale < 1:
        from PIL import Image

        camera = camera.scaled(scale)
        planes = [Image.fromarray(np.ascontiguousarray(plane)) for plane in np.moveaxis(values, -1, 0)]
        # A filter without overshoots and aliases: each new pixel is an average of all pixels that it covers.
        smaller = [plane.resize((camera.width, camera.height), Image.Resampling.HAMMING) for plane in planes]
        values = np.stack([np.asarray(plane) for plane in smaller], axis=-1)
    return values.reshape(*values.shape[:2], *np.shape(image)[2:]), camera


def blocks(rows: slice) -> Iterator[tuple[slice, slice]]:
    """Yield blocks of `rows`, each counted from the first of `rows` and from the first row of the picture."""
    for top in range(rows.start, rows.stop, ROWS):
        stop = min(top + ROWS, rows.stop)
        yield slice(top - rows.start, stop - rows.start), slice(top, stop)


def warn_of_encoded_floats(array: NDArray[Any]) -> None:
    """Warn if floats are probably encoded values, judged by some rows.

    Whole numbers beyond 1 are, and multiples of 1/255: 8 bits hold encoded values, because they are too few for light.
    Brightness decides nothing: that of dark encoded pictures and of bright light is the same.
    """
    if array.dtype.kind != "f":
        return
    colours = array[..., :-1] if array.ndim == 3 and array.shape[2] in (2, 4) else array
    rows = colours[:: max(1, len(colours) // 16)]  # some 16 rows
    with np.errstate(invalid="ignore"):  # NaN: refused later
        steps = 255 * rows.clip(0, 1).astype(np.float64)
    # Larger numbers than those of 16 bits are no encoded values, and floats of any kind beyond 2^24 are whole.
    is_whole = 1 < rows.max() <= np.iinfo(np.uint16).max and (rows == np.round(rows)).all()
    is_fraction = (
        (rows.min() >= 0 and rows.max() <= 1)
        and (np.abs(steps - np.rint(steps)) <= 255 * np.finfo(rows.dtype).eps).all()
        and len(np.setdiff1d(np.rint(steps), [0, 255])) >= LEAST_LEVELS
    )
    if is_whole or is_fraction:
        warnings.warn(
            "the picture has floats, which mean linear light, but they are whole numbers or multiples of 1/255 like "
            'encoded values: convert it to uint8 or uint16, or set transfer="srgb", or transfer="linear" if they are '
            "light",
            RsdeblurWarning,
            stacklevel=3,
        )


@lru_cache(maxsize=8)
def _lookup(itemsize: int, transfer: Transfer) -> NDArray[np.float32]:
    """Return the light of every value of an unsigned integer; a power for each pixel would take five times as long."""
    values = np.arange(1 << 8 * itemsize, dtype=f"u{itemsize}")
    return to_linear(as_float(values), transfer)


def display_values(pixels: NDArray[Any], transfer: Transfer) -> NDArray[Any]:
    """Return values for display, integers divided by their full scale, clipped to [0, 1]; linear light becomes sRGB."""
    clipped = as_float(pixels).clip(0.0, 1.0)
    return from_linear(clipped, "srgb") if transfer == "linear" else clipped


def _stored(
    light: NDArray[np.float32], transfer: Transfer, clip: bool, dtype: np.dtype[Any]
) -> tuple[NDArray[Any], bool]:
    """Return encoded light as values of a type, and whether all of it is finite."""
    if transfer == "srgb":
        values, is_finite = to_srgb(np.ascontiguousarray(light), dtype)
        return values.clip(0.0, 1.0, out=values) if clip and dtype.kind != "u" else values, is_finite
    values = from_linear(light, transfer)
    with np.errstate(over="ignore", invalid="ignore"):
        # One pass instead of the two of np.isfinite(values).all().
        is_finite = bool(np.isfinite(values.sum()))
        return as_stored(values.clip(0.0, 1.0) if clip else values, dtype), is_finite


@dataclass(frozen=True, slots=True, eq=False)
class ReadoutFrame:
    """Conversion between the picture as stored and the upright frame, a quarter clockwise for a horizontal readout."""

    stored: Camera  # of the picture as stored

    @property
    def quarter(self) -> bool:
        """Whether the upright frame is turned by a quarter from the stored one."""
        return self.stored.horizontal_readout

    @property
    def camera(self) -> Camera:
        """The camera of the upright picture."""
        return self.stored.turned() if self.quarter else self.stored

    def capture(
        self, log: GyroLog, exposure: Exposure, translation: Translation | None = None, **options: Any
    ) -> Capture:
        """Return the capture of the upright camera; parameters and errors are those of `Capture.from_log`."""
        return Capture.from_log(log, self.camera, exposure, self.translation(translation), **options)

    def translation(self, stored: Translation | None) -> Translation | None:
        """Return a translation of the stored camera as one of the upright camera."""
        return stored.turned() if stored is not None and self.quarter else stored

    def image(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the upright view of a stored array of shape (H, W) or (H, W, C)."""
        return np.rot90(array, -1) if self.quarter else array

    def back(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the stored view of an upright array."""
        return np.rot90(array) if self.quarter else array

    def bank(self, upright: PsfBank) -> PsfBank:
        """Return upright PSFs turned, with their places, to the picture as stored."""
        return upright.turned(self.stored.height) if self.quarter else upright


def upright(light: FloatImage, camera: Camera, scale: float) -> NDArray[np.float32]:
    """Return a picture as stored (H, W), reduced as by `skimage.transform.resize`, and with the readout along y."""
    # scikit-image takes 0.14 s to import.
    small = camera.scaled(scale)
    shape = small.height, small.width
    if light.shape != shape:
        ratios = np.divide(light.shape, shape)
        smooth = ndimage.gaussian_filter(light, np.maximum(ratios - 1, 0) / 2, mode="mirror")
        light = ndimage.zoom(smooth, 1 / ratios, order=1, mode="mirror", grid_mode=True)
    return np.ascontiguousarray(ReadoutFrame(small).image(light), dtype=np.float32)
