"""Types of options: times, counts, strengths, sizes, rates."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any, ClassVar, Literal

import click

from rsdeblur import choices
from rsdeblur.choices import Auto, Count, Strength, Transfer

Start = float | Literal["exif"]
Bias = tuple[float, float, float]


class NonEmptyPath(click.Path):
    """A path; an empty one, as of a shell variable that is not set, would mean the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if not str(value):
            self.fail("the name is empty", param, ctx)
        try:
            return super().convert(value, param, ctx)
        except ValueError:
            self.fail(f"no file can have the name {value!r}", param, ctx)


PATH = NonEmptyPath(path_type=Path)


class NumberType(click.FloatRange):
    """A number in a range, which NaN is not."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


POSITIVE = NumberType(min=0.0, min_open=True)


class SecondsType(click.ParamType[float]):
    """A time: `0.05`, `1/20` or `50ms`; if it is a length, positive or at least not negative."""

    name = "SECONDS"

    def __init__(self, *, above: float | None = None, minimum: float | None = None) -> None:
        self.above, self.minimum = above, minimum

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return seconds."""
        seconds = value if isinstance(value, float) else self._seconds(value, param, ctx)
        if self.above is not None and seconds <= self.above:
            self.fail(f"{value} is not greater than {self.above:g}", param, ctx)
        if self.minimum is not None and seconds < self.minimum:
            self.fail(f"{value} is less than {self.minimum:g}", param, ctx)
        return seconds

    def _seconds(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
        match = re.fullmatch(rf"{number}(?:/{number})?\s*(s|ms|us)?", str(value))
        try:
            if match is None:
                raise ValueError(value)
            above, below, unit = match.groups(default="")
            seconds = float(above) / float(below or 1.0) / {"": 1.0, "s": 1.0, "ms": 1e3, "us": 1e6}[unit]
            if not math.isfinite(seconds):
                raise ValueError(value)
            return seconds
        except (ValueError, ZeroDivisionError):
            self.fail(f"{value!r} is not a time; write 0.05, 1/20 or 50ms", param, ctx)


class StartType(SecondsType):
    """A time, or `exif`: that of the photo's EXIF block."""

    name = "SECONDS|exif"

    def convert(  # type: ignore[override]
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Start:
        """Return seconds, or "exif"."""
        return "exif" if value == "exif" else super().convert(value, param, ctx)


class PairType(click.ParamType[tuple[float, float]]):
    """Two numbers, `X,Y`."""

    name = "X,Y"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Return both numbers."""
        try:
            x, y = (float(number) for number in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a pair of numbers; write 3,-2", param, ctx)
        return x, y


class DepthType(click.ParamType[Any]):
    """A distance in m, or the file of a map of depths."""

    name = "METRES|FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | Path:
        """Return the distance, or the file's path."""
        try:
            number = float(value)
        except ValueError:
            return Path(value)
        return float(POSITIVE.convert(number, param, ctx))


class AutoType(click.ParamType[Any]):
    """A whole number from 1 up, or `auto`."""

    name = "N|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Count:
        """Return the number, or "auto"."""
        return "auto" if value == "auto" else click.IntRange(min=1).convert(value, param, ctx)


class StrengthType(click.ParamType[Any]):
    """A positive number, or `auto`."""

    name = "X|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Strength:
        """Return the number, or "auto"."""
        return "auto" if value == "auto" else POSITIVE.convert(value, param, ctx)


class BytesType(click.ParamType[Any]):
    """An amount of memory: 500MB, 1GiB."""

    name = "SIZE"
    units: ClassVar = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 2**10, "mib": 2**20, "gib": 2**30}

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number of bytes."""
        match = re.fullmatch(r"(\d+(?:\.\d*)?)\s*([kmg]i?b)?", str(value).strip().lower())
        if not match:
            self.fail(f"{value!r} is not an amount of memory like 1GiB or 500MB", param, ctx)
        return int(float(match[1]) * self.units[match[2] or ""])


class TransferType(click.ParamType[Any]):
    """Encoding of light in pixel values: a name, a gamma, or `auto`."""

    name = "auto|linear|srgb|GAMMA"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Transfer | Auto:
        """Return the name, or the gamma as a number."""
        names: tuple[Literal["auto", "linear", "srgb"], ...] = ("auto", *choices.TRANSFERS)
        for name in names:
            if value == name:
                return name
        return float(POSITIVE.convert(value, param, ctx))


class SizeType(click.ParamType[tuple[int, int]]):
    """Size of a picture, `WIDTHxHEIGHT`."""

    name = "WIDTHxHEIGHT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return (width, height)."""
        match = re.fullmatch(r"(\d+)x(\d+)", str(value))
        if match is None:
            self.fail(f"{value!r} is not a size; write 1024x768", param, ctx)
        return int(match[1]), int(match[2])


class BiasType(click.ParamType[Any]):
    """Three angular rates: `0.01,-0.02,0.005` in rad/s, or with a unit, `-1.8,0,0.1deg/s`."""

    name = "WX,WY,WZ"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Bias:
        """Return rad/s."""
        if isinstance(value, tuple):
            return value
        text, degrees = re.subn(r"\s*deg/s$", "", str(value).strip())
        try:
            x, y, z = (float(number) for number in re.sub(r"\s*rad/s$", "", text).split(","))
        except ValueError:
            self.fail(f"{value!r} is not three rates; write 0.01,-0.02,0.005 (rad/s) or -1.8,0,0.1deg/s", param, ctx)
        if not math.isfinite(x + y + z):
            self.fail(f"{value!r} must be finite", param, ctx)
        return (math.radians(x), math.radians(y), math.radians(z)) if degrees else (x, y, z)
