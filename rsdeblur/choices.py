"""The named choices that options offer, each typed once, and defaults that commands name in their help.

Loading this module loads nothing else.
"""

from typing import Literal, get_args

Mode = Literal["global", "banded", "rowwise"]
MODES: tuple[Mode, ...] = get_args(Mode)

Prior = Literal["wiener", "gradient", "tv", "hyper-laplacian", "cnn"]
PRIORS: tuple[Prior, ...] = get_args(Prior)
# Penalties on derivatives; `rsdeblur.deconv.priors.KINDS` describes them.
DERIVATIVE_PRIORS: tuple[Prior, ...] = ("gradient", "tv", "hyper-laplacian")
# Their results are linear in the picture.
LINEAR_PRIORS: tuple[Prior, ...] = ("wiener", "gradient")
# Module and function of the denoisers; another one needs its file, its name above and a row here.
DENOISERS: dict[str, tuple[str, str]] = {"cnn": ("rsdeblur.deconv.cnn", "cnn_denoise")}

# Sets mode and prior together, unless they are set themselves. The mode "auto" is chosen by the motion.
Quality = Literal["fast", "balanced", "best"]
QUALITIES: dict[Quality, tuple[Mode | Literal["auto"], Prior]] = {
    "fast": ("banded", "wiener"),
    "balanced": ("auto", "hyper-laplacian"),
    "best": ("rowwise", "hyper-laplacian"),
}

# What the check says of a result, from the best to the worst.
Verdict = Literal["good", "cannot tell", "doubtful", "bad"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

# Exponent of the hyper-Laplacian.
EXPONENT = 2 / 3

# px. The interpolation of colours in a sensor, and lenses, blur a picture by about KEEP anyway. Beyond DROP, deblurring
# gains little, and about half of the results are doubtful (docs/developer/decisions.md):
# python -m benchmarks.still --lengths 5 10 20 35 50 75 100
KEEP, DROP = 1.5, 100.0

# Constant rate factor of the encoding of videos.
CRF = 17

# Appended to the name of a result beside its photo, or of the folder of a batch's results.
SHARP = "-sharp"

# File beside the results of a batch that lists them; default name of a camera file.
BATCH, CAMERA = "batch.json", "camera.toml"


Geometry = Literal["keep", "rectify"]
GEOMETRIES: tuple[Geometry, ...] = get_args(Geometry)

Motion = Literal["rotation", "small-angle"]
MOTIONS: tuple[Motion, ...] = get_args(Motion)

# How a solver itself continues a picture beyond its frame ...
Border = Literal["blend", "periodic"]
BORDERS: tuple[Border, ...] = get_args(Border)
# ... and the alternative that leaves open what lies beyond the frame.
Boundary = Literal["unknown"]
BOUNDARIES: tuple[Boundary, ...] = get_args(Boundary)

Saturation = Literal["ignore", "auto", "always"]
SATURATIONS: tuple[Saturation, ...] = get_args(Saturation)

# Resolution at which colours are restored.
Chroma = Literal["full", "half"]
CHROMAS: tuple[Chroma, ...] = get_args(Chroma)

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
