"""Tone curves: from integers to linear light by a table, and that of sRGB back."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import Float32Array

# IEC 61966-2-1: light up to END is multiplied by SLOPE; above, the curve is SCALE light^(1 / GAMMA) - OFFSET.
END, SLOPE, SCALE, OFFSET = map(np.float32, (0.0031308, 12.92, 1.055, 0.055))
GAMMA = 2.4


@njit(nogil=True)
def _look_up(table, values, light):
    for i in range(len(values)):
        light[i] = table[values[i]]


def look_up(table: Float32Array, values: NDArray[Any], light: Float32Array) -> None:
    """Decode uint8 or uint16 of any shape by a `table` of the light of all their values, into `light`.

    It takes 0.2 to 0.6 of the time of :func:`numpy.take`, and threads may share the rows.
    """
    _look_up(read_only(table), read_only(values).reshape(-1), light.reshape(-1))


# NumPy's vectorised power is several times as fast as Numba's; to choose between both parts of the curve, it is slower.
@njit(nogil=True)
def _encode(light, powers, most, out):
    """Fill `out` with encoded values: those of light, or if `most` is not 0 integers up to it, clipped.

    Return whether all light is finite.
    """
    lost, zero, one = 0, np.float32(0.0), np.float32(1.0)
    for i in range(len(light)):
        magnitude = abs(light[i])
        value = np.copysign(magnitude * SLOPE if magnitude <= END else powers[i] * SCALE - OFFSET, light[i])
        out[i] = value if most == 0 else np.int32(np.rint(min(max(value, zero), one) * most))
        lost += not magnitude < np.inf
    return lost == 0


def to_srgb(light: Float32Array, dtype: np.dtype[Any] | type = np.float32) -> tuple[NDArray[Any], bool]:
    """Return encoded values of linear light, C-contiguous, and whether all of it is finite.

    In float32 negative light keeps its sign. As uint8 and uint16 values are clipped, and the largest integer is 1.
    """
    powers = np.abs(light, out=np.empty_like(light))
    np.power(powers, np.float32(1 / GAMMA), out=powers)
    # Not in place: the compiler makes SIMD code where it reads and writes different memory.
    out = np.empty(light.shape, dtype)
    most = np.float32(0 if out.dtype.kind == "f" else np.iinfo(dtype).max)
    return out, _encode(light.reshape(-1), powers.reshape(-1), most, out.reshape(-1))
