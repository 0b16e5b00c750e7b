"""Names of the array and callback types that the whole package uses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Numbers in double precision: times, angles, places."""

FloatImage = NDArray[np.float32]
"""A picture, or rows of one, in linear light unless stated otherwise."""

Progress = Callable[[str, float], None]
"""Called as ``progress(stage, fraction)`` while long work goes on."""

StageProgress = Callable[[float], None]
"""Called with the finished fraction of one stage."""
