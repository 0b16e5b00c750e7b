"""The named choices that options offer, each typed once, and defaults that commands name in their help.

Loading this module loads nothing else.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

Mode = Literal["global", "banded", "rowwise"]
MODES: tuple[Mode, ...] = get_args(Mode)

Prior = Literal["wiener", "gradient", "tv", "hyper-laplacian", "wavelet", "nlm", "cnn"]
PRIORS: tuple[Prior, ...] = get_args(Prior)

# Sets mode and prior together, unless they are set themselves.
Quality = Literal["fast", "balanced", "best"]
QUALITIES: dict[Quality, tuple[Mode, Prior]] = {
    "fast": ("banded", "wiener"),
    "balanced": ("banded", "hyper-laplacian"),
    "best": ("rowwise", "hyper-laplacian"),
}
# Default of mode and prior; of every type, because Options replaces it.
BY_QUALITY: Any = None

# What the check says of a result, from the best to the worst.
Verdict = Literal["good", "cannot tell", "doubtful", "bad"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

# Exponent of the hyper-Laplacian.
EXPONENT = 2 / 3

# px. The interpolation of colours in a sensor, and lenses, blur a picture by about KEEP anyway. Simulated pictures with
# paths of DROP come out of `deblur` as clear as those with paths of 3 to 4 px go in; longer paths lose more
# (docs/developer/decisions.md).
KEEP, DROP = 1.5, 20.0

# Frames of a video that are encoded together, and the constant rate factor of their encoding.
SEGMENT, CRF = 32, 17

# Folder beside the results of a batch in which it records what is done.
RECORDS = ".rsdeblur-batch"

Solver = Literal["auto", "direct", "cg"]
SOLVERS: tuple[Solver, ...] = get_args(Solver)

Geometry = Literal["keep", "rectify"]
GEOMETRIES: tuple[Geometry, ...] = get_args(Geometry)

Motion = Literal["rotation", "small-angle"]
MOTIONS: tuple[Motion, ...] = get_args(Motion)

# How a solver itself continues a picture beyond its frame ...
Border = Literal["blend", "periodic"]
BORDERS: tuple[Border, ...] = get_args(Border)
# ... and the alternatives that make a picture periodic before a solver with border="periodic", or, for "unknown", one
# that leaves open what lies beyond the frame.
Boundary = Literal["reflect", "edge-taper", "smooth", "unknown"]
BOUNDARIES: tuple[Boundary, ...] = get_args(Boundary)

Saturation = Literal["ignore", "auto", "always"]
SATURATIONS: tuple[Saturation, ...] = get_args(Saturation)

# Resolution at which colours are restored.
Chroma = Literal["full", "half"]
CHROMAS: tuple[Chroma, ...] = get_args(Chroma)

Planning = Literal["estimate", "measure"]
PLANNINGS: tuple[Planning, ...] = get_args(Planning)

# A number is a gamma: light = value ** gamma.
Transfer = Literal["linear", "srgb"] | float
TRANSFERS: tuple[Literal["linear", "srgb"], ...] = ("linear", "srgb")

ReadoutDirection = Literal["top-down", "bottom-up", "left-right", "right-left"]
READOUT_DIRECTIONS: tuple[ReadoutDirection, ...] = get_args(ReadoutDirection)

# Moment that a capture's timestamp marks: start of the first row, middle of the middle row, end of the last row.
TimestampMarks = Literal["start", "middle", "end"]
TIMESTAMP_MARKS: tuple[TimestampMarks, ...] = get_args(TimestampMarks)

Distortion = Literal["none", "radtan", "fisheye"]
DISTORTIONS: tuple[Distortion, ...] = get_args(Distortion)

Auto = Literal["auto"]
Count = int | Auto
Strength = float | Auto
