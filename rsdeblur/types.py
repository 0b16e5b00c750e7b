"""Array and callback types of the whole package."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Values in double precision: times, angles, positions."""

FloatImage = NDArray[np.float32]
"""Picture, or rows of one, in linear light unless stated otherwise."""

Float32Array = NDArray[np.float32]
"""Other values in single precision: lines, weights, tables, real and imaginary parts."""

ComplexArray = NDArray[np.complex64]
"""Spectra in single precision."""

Int32Array = NDArray[np.int32]
"""Positions for the kernels."""

Progress = Callable[[str, float], None]
"""Function called as ``progress(stage, fraction)`` during long work; the fraction runs from 0 to 1."""

StageProgress = Callable[[float], None]
"""Function called with the finished fraction of one stage, from 0 to 1."""

Denoiser = Callable[[FloatImage, float], FloatImage]
"""Function called as ``denoise(image, sigma)``; it removes noise of the standard deviation sigma."""
