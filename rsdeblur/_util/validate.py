"""Checks of arguments: each returns the normalised value or raises `InputError`."""

import math
from collections.abc import Collection, Iterable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util.memory import empty
from rsdeblur.errors import InputError
from rsdeblur.types import FloatArray

# Largest absolute value of a picture, in linear light of nominal range [0, 1]. Its square times 10^14, the number of
# values that are added up and the square of a filter's gain, is within float32.
MOST_LIGHT = 1e12
# s; times of float64 are exact to 0.1 ms up to here.
MOST_SECONDS = 1e12
# Largest `nsr`, `weight` and inverse of both. Penalties are up to 10^9 times a weight, and their products are within
# float32.
MOST_STRENGTH = 1e20
# Most values of a picture: 500 megapixels of four channels.
MOST_VALUES = 2_000_000_000

Kind = TypeVar("Kind")
Item = TypeVar("Item")


def instance(name: str, value: object, kind: type[Kind], *others: type[Kind]) -> Kind:
    """Return `value`, which must be a `kind` or one of the `others`."""
    if isinstance(value, kind) or isinstance(value, others):  # noqa: SIM101 (as mypy understands it)
        return value
    kinds = " or ".join(each.__name__ for each in (kind, *others))
    article = "an" if kinds[0] in "AEIO" else "a"
    raise InputError(f"{name} must be {article} {kinds}, got {shown(value)}")


def shown(value: object) -> str:
    """Return a short text for a value that is refused: the number or text itself, or the type of anything else."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"a number of {value.bit_length()} bits"
    text = repr(value) if value is None or isinstance(value, (str, bytes, int, float, complex)) else ""
    return text if 0 < len(text) <= 80 else type(value).__name__


def missing(need: str, extra: str) -> str:
    """Return the message that something needs a package, and how to install it with the `extra` of this project."""
    # The package is on no index.
    return f"{need}; run in the folder of rsdeblur's source code: pip install '.[{extra}]'"


def boolean(name: str, value: object) -> bool:
    """Return `value`, which must be True or False."""
    if not isinstance(value, bool):
        raise InputError(f"{name} must be True or False, got {shown(value)}")
    return value


def items(name: str, value: Iterable[Item]) -> Iterable[Item]:
    """Return `value`, which must be a sequence or another iterable of objects."""
    try:
        iter(value)
    except TypeError:
        raise InputError(f"{name} must be a sequence, got {shown(value)}") from None
    return value


def is_auto(value: object) -> bool:
    """Return whether an option is "auto"; anything else may be compared in ways of its own."""
    return isinstance(value, str) and value == "auto"


def callback(name: str, value: Any) -> Any:
    """Return `value`, which must be None or callable."""
    if value is not None and not callable(value):
        raise InputError(f"{name} must be a function or None, got {shown(value)}")
    return value


def finite(
    name: str, value: Any, *, minimum: float | None = None, above: float | None = None, maximum: float | None = None
) -> float:
    """Return `value` as a float; it must be finite, at least `minimum`, greater than `above` and at most `maximum`."""
    try:
        if isinstance(value, (str, bytes)) or np.ndim(value) > 0:
            raise TypeError
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a number, got {shown(value)}") from None
    if not np.isfinite(number):
        raise InputError(f"{name} must be finite, got {number}")
    if minimum is not None and number < minimum:
        raise InputError(f"{name} must be at least {minimum:g}, got {number:g}")
    if above is not None and number <= above:
        raise InputError(f"{name} must be greater than {above:g}, got {number:g}")
    if maximum is not None and number > maximum:
        raise InputError(f"{name} must be at most {maximum:g}, got {number:g}")
    return number + 0.0  # without the sign of -0.0, which NumPy refuses as a deviation


# A time in s; the standard deviation of a picture's noise in linear light; the exponent of a hyper-Laplacian; and that
# of lens, pixels and demosaicing in px: the window by which rows are drawn holds four of the largest.
time = partial(finite, minimum=-MOST_SECONDS, maximum=MOST_SECONDS)
noise = partial(finite, minimum=0.0, maximum=MOST_LIGHT)
exponent = partial(finite, above=0.0, maximum=1.0)
softness = partial(finite, minimum=0.0, maximum=1.0)


def strength(name: str, value: Any) -> float:
    """Return a noise-to-signal ratio or the weight of a prior, from 1e-20 to 1e20."""
    return finite(name, finite(name, value, above=0.0), minimum=1 / MOST_STRENGTH, maximum=MOST_STRENGTH)


def count(name: str, value: Any, *, minimum: int = 1, maximum: int | None = None) -> int:
    """Return `value` as an int; it must be a whole number of at least `minimum` and at most `maximum`."""
    # NumPy counts its durations among the integers.
    if isinstance(value, (bool, np.timedelta64)) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} must be a whole number, got {shown(value)}")
    if value < minimum:
        raise InputError(f"{name} must be at least {minimum}, got {shown(int(value))}")
    if maximum is not None and value > maximum:
        raise InputError(f"{name} must be at most {maximum}, got {shown(int(value))}")
    return int(value)


# A whole number of nanoseconds that fits into 64 bits.
nanoseconds = partial(count, minimum=-(2**63), maximum=2**63 - 1)


def choice(name: str, value: object, allowed: Collection[str]) -> str:
    """Return `value` if it is one of `allowed`."""
    if not isinstance(value, str) or value not in allowed:
        raise InputError(f"{name} must be one of {', '.join(sorted(allowed))}; got {shown(value)}")
    return value


def shape(value: Any) -> tuple[int, ...]:
    """Return the shape of a picture, (H, W) or (H, W, C), as a tuple of ints of at least 1."""
    if not isinstance(value, (tuple, list)) or len(value) not in (2, 3):
        raise InputError(
            f"shape must be (H, W) or (H, W, C), got {value if isinstance(value, tuple) else shown(value)}"
        )
    counts = tuple(count("shape", n, maximum=MOST_VALUES) for n in value)
    if math.prod(counts) > MOST_VALUES:
        raise InputError(f"shape must be that of at most {MOST_VALUES} values, got {counts}")
    return counts


def array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value`, which must be real numbers or booleans, as an array; a list becomes one."""
    if isinstance(value, np.ma.MaskedArray):
        raise InputError(f"{name} must not be a masked array: choose values for masked elements with .filled()")
    if hasattr(value, "pixels"):
        raise InputError(f"{name} must be an array, got {shown(value)}; pass its .pixels")
    try:
        numbers = np.asarray(value)
        if numbers.dtype.kind == "O" and not isinstance(value, np.ndarray):  # fractions, integers beyond 64 bits
            numbers = numbers.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be an array of real numbers: {error}") from None
    if numbers.dtype.kind not in "biuf":
        raise InputError(f"{name} must be an array of real numbers, got {shown(value)} of type {numbers.dtype}")
    return numbers


def real_array(
    name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None, *, most: float | None = None
) -> FloatArray:
    """Return a read-only, C-contiguous float64 copy of finite real numbers; messages call them `name`.

    In the expected `shape`, None is any length; without one, any shape will do. `most` is the largest absolute value.
    """
    numbers = array(name, value)
    with np.errstate(over="ignore", invalid="ignore"):  # infinity, or a signalling NaN: refused below
        numbers = np.array(numbers, dtype=np.float64, order="C")
    if shape is not None and (
        numbers.ndim != len(shape)
        or any(n not in (None, length) for n, length in zip(shape, numbers.shape, strict=True))
    ):
        expected = ", ".join("n" if n is None else str(n) for n in shape)
        raise InputError(f"{name} must have shape ({expected}), got {numbers.shape}")
    if not np.isfinite(numbers).all():
        bad = tuple(map(int, np.argwhere(~np.isfinite(numbers))[0]))
        raise InputError(f"{name} must be finite, got {numbers[bad]} at index {bad}")
    if most is not None and numbers.size and np.abs(numbers).max() > most:
        raise InputError(f"{name} must not be beyond {most:g}, got {numbers.flat[np.abs(numbers).argmax()]:g}")
    numbers.setflags(write=False)
    return numbers


def increasing(name: str, places: FloatArray) -> None:
    """Raise `InputError` unless numbers increase."""
    (wrong,) = np.nonzero(np.diff(places) <= 0)
    if wrong.size:
        before, after = places[wrong[0] : wrong[0] + 2]
        raise InputError(f"{name} must increase, got {before:g} before {after:g}")


def linear_light(image: ArrayLike, shape: tuple[int, ...] | None = None) -> NDArray[np.float32]:
    """Return `image` as C-contiguous float32 of the planned `shape`, by default any (H, W) or (H, W, C).

    It is copied only if needed. Integers are refused: they are encoded values, and would be taken as light of up to 255
    or 65535. So are values that are not finite, or beyond 1e12.
    """
    light = array("image", image)
    kind = light.dtype.kind
    if kind != "f":
        hint = "; convert encoded values with rsdeblur.image.transfer.to_linear" if kind in "iu" else ""
        raise InputError(f"image must be linear light as floats, got {light.dtype}{hint}")
    if shape is None and (light.ndim not in (2, 3) or light.size == 0):
        raise InputError(f"image must have shape (H, W) or (H, W, C), got {light.shape}")
    if shape is not None and light.shape != shape:
        raise InputError(f"image must have the planned shape {shape}, got {light.shape}")
    bounded("image", light)
    return np.ascontiguousarray(light, dtype=np.float32)


def bounded(name: str, light: NDArray[Any]) -> None:
    """Raise `InputError` unless all values of a picture in linear light are finite and at most `MOST_LIGHT`."""
    least, most = float(light.min()), float(light.max())  # NaN if any value is
    if least >= -MOST_LIGHT and most <= MOST_LIGHT:
        return
    if not (np.isfinite(least) and np.isfinite(most)):
        raise InputError(f"{name} must be finite")
    raise InputError(f"{name} must not have values beyond {MOST_LIGHT:g}, got {max(most, -least):g}; white should be 1")


def memory(what: str, size: int, pixels: int) -> None:
    """Raise `InputError` if something takes more bytes than the size of the picture justifies."""
    # Twenty times what automatic choices need for a photo of 12 megapixels, and some for small pictures.
    if size > 8 * 2**30 + 1024 * pixels:
        raise InputError(
            f"{what} would take {size / 2**30:.0f} GiB; use fewer bands and strips, a larger nsr or a shorter blur"
        )


def not_beyond_white(image: NDArray[Any], remedy: str, white: float = 1.0) -> None:
    """Raise `InputError` if most values of a picture are beyond `white`, and would become white in integers."""
    if image.dtype.kind == "f" and np.median(image[::4, ::4]) > white:
        raise InputError(
            f"image has values of up to {image.max():g}, most of them beyond 1, which is white and the most that "
            f"integers can hold: divide image by its full scale, or {remedy}"
        )


def output(out: Any, shape: tuple[int, ...], kinds: Sequence[type] = (np.float32,)) -> NDArray[Any]:
    """Return `out`, a writable array of `shape` and of one of `kinds`, C-contiguous if that is float32 only.

    If `out` is None, it is a new array of float32.
    """
    if out is None:
        return empty(shape, np.float32)
    is_plain = isinstance(out, np.ndarray) and not isinstance(out, (np.ma.MaskedArray, np.matrix))
    if not is_plain or out.shape != shape or out.dtype not in kinds:
        got = f"{out.dtype} of shape {out.shape}" if is_plain else type(out).__name__
        names = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"out must be a {names} array of shape {shape}, got {got}")
    if not out.flags.writeable or (len(kinds) == 1 and not out.flags.c_contiguous):
        raise InputError("out must be writable and C-contiguous")
    array: NDArray[Any] = out
    return array
