"""Checks of arguments: each returns the normalised value or raises `InputError`."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur.errors import InputError
from rsdeblur.types import FloatArray


def finite(name: str, value: float, *, minimum: float | None = None, above: float | None = None) -> float:
    """Return `value` as a float; it must be finite, at least `minimum` and greater than `above`."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, got {value!r}") from None
    except OverflowError:
        raise InputError(f"{name} is too large for a number") from None
    if not np.isfinite(number):
        raise InputError(f"{name} must be finite, got {number}")
    if minimum is not None and number < minimum:
        raise InputError(f"{name} must be at least {minimum:g}, got {number:g}")
    if above is not None and number <= above:
        raise InputError(f"{name} must be greater than {above:g}, got {number:g}")
    return number


def exponent(value: float) -> float:
    """Return the exponent of a hyper-Laplacian, which must be in (0, 1]."""
    number = finite("exponent", value, above=0.0)
    if number > 1.0:
        raise InputError(f'exponent must be at most 1, got {number:g}; for 2 use prior="gradient"')
    return number


def count(name: str, value: Any, *, minimum: int = 1, maximum: int | None = None) -> int:
    """Return `value` as an int; it must be a whole number of at least `minimum` and at most `maximum`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} must be a whole number, got {value!r}")
    if value < minimum:
        raise InputError(f"{name} must be at least {minimum}, got {value}")
    if maximum is not None and value > maximum:
        raise InputError(f"{name} must be at most {maximum}, got a number of {int(value).bit_length()} bits")
    return int(value)


def nanoseconds(name: str, value: Any) -> int:
    """Return `value` as an int; it must be a whole number of nanoseconds that fits into 64 bits."""
    number = count(name, value, minimum=-(2**63))
    if number >= 2**63:
        raise InputError(f"{name} must be nanoseconds in 64 bits, got a number of {number.bit_length()} bits")
    return number


def choice(name: str, value: object, allowed: Collection[str]) -> str:
    """Return `value` if it is one of `allowed`."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(sorted(allowed))}; got {value!r}")
    return value


def real_array(
    name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None, *, most: float | None = None
) -> FloatArray:
    """Return a read-only float64 copy of `value`.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    value : array_like
        Finite real numbers.
    shape : tuple of int or None, optional
        Expected shape, in which None is any length; default any shape.
    most : float, optional
        Largest absolute value.

    Returns
    -------
    ndarray, float64, C-contiguous
        The copy.

    Raises
    ------
    InputError
        If `value` does not fit.
    """
    try:
        if np.iscomplexobj(value):
            raise TypeError("it is complex")
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be an array of real numbers: {error}") from None
    if shape is not None and (
        array.ndim != len(shape) or any(n not in (None, length) for n, length in zip(shape, array.shape, strict=True))
    ):
        expected = ", ".join("n" if n is None else str(n) for n in shape)
        raise InputError(f"{name} must have shape ({expected}), got {array.shape}")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        raise InputError(f"{name} must be finite, got {array[tuple(bad[0])]} at index {tuple(map(int, bad[0]))}")
    if most is not None and array.size and np.abs(array).max() > most:
        raise InputError(f"{name} must not be beyond {most:g}, got {array.flat[np.abs(array).argmax()]:g}")
    array.setflags(write=False)
    return array


def linear_light(image: ArrayLike, shape: tuple[int, ...] | None = None) -> NDArray[np.float32]:
    """Return `image` as C-contiguous float32 of the planned `shape`, by default any (H, W) or (H, W, C).

    It is copied only if needed. Integers are refused: they are encoded values, and would be taken as light of up to 255
    or 65535.
    """
    try:
        array = np.asarray(image)
    except ValueError as error:
        raise InputError(f"image must be an array of floats: {error}") from None
    kind = array.dtype.kind
    if kind in "iu":
        white = np.iinfo(array.dtype).max if kind == "u" else "full_scale"
        raise InputError(
            f"image must be linear light as floats, got {array.dtype}; convert encoded values with "
            f'rsdeblur.image.transfer.to_linear(image.astype("float32") / {white}, "srgb")'
        )
    if kind != "f":
        raise InputError(f"image must be linear light as floats, got {array.dtype}")
    if shape is None and (array.ndim not in (2, 3) or array.size == 0):
        raise InputError(f"image must have shape (H, W) or (H, W, C), got {array.shape}")
    if shape is not None and array.shape != shape:
        raise InputError(f"image must have the planned shape {shape}, got {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float32)


def picture(image: ArrayLike, shape: tuple[int, ...] | None = None) -> NDArray[np.float32]:
    """Return `image` as :func:`linear_light` does; it must be finite."""
    array = linear_light(image, shape)
    if not np.isfinite(array).all():
        raise InputError("image must be finite")
    return array


def output(out: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return `out`, which must be a writable C-contiguous float32 array of `shape`, or a new one if `out` is None."""
    if out is None:
        return np.empty(shape, dtype=np.float32)
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != np.float32:
        got = f"{out.dtype} of shape {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise InputError(f"out must be a float32 array of shape {shape}, got {got}")
    if not (out.flags.writeable and out.flags.c_contiguous):
        raise InputError("out must be writable and C-contiguous")
    return out
