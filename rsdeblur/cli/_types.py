"""Types of option values: times, counts, strengths, sizes, rates. Manifests use them for their cells."""

import math
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import click

from rsdeblur import choices


class PathType(click.Path):
    """A path; an empty one, as of a shell variable that is not set, would mean the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if not str(value):
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


class NumberType(click.FloatRange):
    """A number in a range, which NaN is not."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


class TextType(click.ParamType[Any]):
    """Values that a function reads from text; its `ValueError` is wrong usage."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name, self.read = name, read

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the form of the text."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value of a text; other values are defaults."""
        if not isinstance(value, str):
            return value
        try:
            return self.read(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)


def seconds(text: str) -> float:
    """Return the time of `0.05`, `1/20` or `50ms`, s."""
    match = re.fullmatch(r"([^/]+?)(?:/([^/]+?))?\s*(s|ms|us)?", text)
    with suppress(ValueError, ZeroDivisionError):
        upper, lower, unit = match.groups("") if match else ("", "", "")
        value = float(upper) / float(lower or 1.0) / {"": 1.0, "s": 1.0, "ms": 1e3, "us": 1e6}[unit]
        if math.isfinite(value):
            return value
    raise ValueError(f"{text!r} is not a time; write 0.05, 1/20 or 50ms")


def numbers(text: str, example: str, count: int | None = None) -> tuple[float, ...]:
    """Return numbers that are separated by commas."""
    try:
        values = tuple(map(float, text.split(",")))
    except ValueError:
        values = (math.nan,)
    if not all(map(math.isfinite, values)) or count not in (None, len(values)):
        raise ValueError(f"{text!r} is not right; write {example}")
    return values


def rates(text: str) -> tuple[float, ...]:
    """Return three angular rates in rad/s."""
    plain, degrees = re.subn(r"\s*deg/s$", "", text.strip())
    values = numbers(re.sub(r"\s*rad/s$", "", plain), "0.01,-0.02,0.005 (rad/s) or -1.8,0,0.1deg/s", count=3)
    return tuple(map(math.radians, values)) if degrees else values


def whole(text: str) -> int:
    """Return a whole number of 64 bits; programs add ".0" to those of a column that has gaps."""
    plain = re.sub(r"\.0+$", "", text)
    if not re.fullmatch(r"[-+]?\d+", plain) or not -(2**63) <= int(plain) < 2**63:
        raise ValueError(f"{text!r} is not a whole number of 64 bits")
    return int(plain)


def size_in_bytes(text: str) -> int:
    """Return the bytes of `500MB` or `1GiB`."""
    match = re.fullmatch(r"(\d+(?:\.\d*)?)\s*(?:([kmg]?)(i?)b)?", text.strip().lower())
    if not match:
        raise ValueError(f"{text!r} is not an amount of memory like 1GiB or 500MB")
    number, prefix, binary = match.groups(default="")
    return int(float(number) * (1024 if binary else 1000) ** ("kmg".index(prefix) + 1 if prefix else 0))


def box(text: str, pattern: str, example: str) -> tuple[int, ...]:
    """Return the whole numbers of a text like `1024x768`."""
    match = re.fullmatch(pattern, text)
    if match is None:
        raise ValueError(f"{text!r} is not right; write {example}")
    return tuple(map(int, match.groups()))


def _or(words: tuple[str, ...], kind: click.ParamType[Any]) -> Callable[[str], Any]:
    return lambda text: text if text in words else kind.convert(text, None, None)


def _in(kind: click.ParamType[Any], read: Callable[[str], Any]) -> Callable[[str], Any]:
    return lambda text: kind.convert(read(text), None, None)


PATH = PathType(path_type=Path)
POSITIVE = NumberType(min=0.0, min_open=True)
NOT_NEGATIVE = NumberType(min=0.0)
COUNT = click.IntRange(min=1)
INDEX = TextType("N", _in(click.IntRange(min=0), whole))
NANOSECONDS = TextType("NS", whole)
SECONDS = TextType("SECONDS", seconds)
DURATION = TextType("SECONDS", _in(POSITIVE, seconds))
READOUT = TextType("SECONDS", _in(NOT_NEGATIVE, seconds))
START = TextType("SECONDS|exif", _or(("exif",), SECONDS))
RATES = TextType("WX,WY,WZ", rates)
PAIR = TextType("X,Y", partial(numbers, example="3,-2", count=2))
SIZE = TextType("WIDTHxHEIGHT", partial(box, pattern=r"(\d+)x(\d+)", example="1024x768"))
# Types of the numbers of `Options`, by the kinds that its fields name.
KINDS: dict[str, click.ParamType[Any]] = {
    "count": TextType("N|auto", _or(("auto",), COUNT)),
    "strength": TextType("X|auto", _or(("auto",), POSITIVE)),
    "noise": TextType("X|auto", _or(("auto",), POSITIVE)),
    "exponent": NumberType(min=0.0, min_open=True, max=1.0),
    "softness": NumberType(0.0, 1.0),
    "transfer": TextType("auto|linear|srgb|GAMMA", _or(("auto", *choices.TRANSFERS), POSITIVE)),
    "threads": COUNT,
    "memory": TextType("SIZE", size_in_bytes),
}
