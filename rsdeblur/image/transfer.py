"""Tone curves between encoded values and linear light, in which blur happens; whole numbers and profiles of files."""

import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.choices import TRANSFERS, Auto, Transfer
from rsdeblur.errors import InputError

# Largest gamma, and its inverse the least: devices use 0.4 to 3, and 255 steps do not survive more.
MOST_GAMMA = 10.0
# Share of the values at either end that counts as outliers.
OUTLIERS = 1e-3


def check_transfer(transfer: Any) -> Transfer:
    """Return `transfer` if it is "linear", "srgb" or a gamma from 0.1 to 10."""
    if isinstance(transfer, str):
        if transfer not in TRANSFERS:
            raise InputError(f'transfer must be "linear", "srgb" or a gamma, got {transfer!r}')
        return "srgb" if transfer == "srgb" else "linear"
    return validate.finite("transfer", transfer, minimum=1 / MOST_GAMMA, maximum=MOST_GAMMA)


def resolve_transfer(transfer: Transfer | Auto, dtype: np.dtype[Any]) -> Transfer:
    """Return a checked transfer; "auto" is sRGB for integers and linear for floats."""
    if validate.is_auto(transfer):
        return "srgb" if dtype.kind == "u" else "linear"
    return check_transfer(transfer)


def to_linear(values: NDArray[np.float32], transfer: Transfer) -> NDArray[np.float32]:
    """Decode encoded values to linear light.

    Parameters
    ----------
    values : ndarray, float32
        Encoded values, nominal range [0, 1]; negative values keep their sign. Divide integers by their full scale, 255
        or 65535, before.
    transfer : {"linear", "srgb"} or float
        The tone curve; a number is a gamma: light = value ** gamma.

    Returns
    -------
    ndarray, float32
        `values` themselves if the curve is linear.

    Raises
    ------
    InputError
        If `values` are unsigned integers, as pictures store them, or no real numbers.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.to_linear([0.0, 0.5, 1.0], "srgb").round(3)
    array([0.   , 0.214, 1.   ], dtype=float32)
    """
    transfer, values = check_transfer(transfer), _floats("values", values)
    if transfer == "linear":
        return values
    magnitude = np.abs(values)
    with np.errstate(over="ignore"):  # becomes infinity
        if transfer == "srgb":
            # IEC 61966-2-1: the curve begins as a straight line.
            light = np.where(magnitude <= 0.04045, magnitude / 12.92, ((magnitude + 0.055) / 1.055) ** 2.4)
        else:
            light = magnitude**transfer
        return np.copysign(light, values).astype(np.float32)


def from_linear(light: NDArray[np.float32], transfer: Transfer) -> NDArray[np.float32]:
    """Encode linear light; the inverse of :func:`to_linear`.

    Parameters
    ----------
    light : ndarray, float32
        Linear light, nominal range [0, 1]; negative values keep their sign.
    transfer : {"linear", "srgb"} or float
        The tone curve; a number is a gamma.

    Returns
    -------
    ndarray, float32
        `light` itself if the curve is linear.

    Raises
    ------
    InputError
        If `light` is unsigned integers or no real numbers.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.from_linear([0.0, 0.214, 1.0], "srgb").round(3)
    array([0. , 0.5, 1. ], dtype=float32)
    """
    transfer, light = check_transfer(transfer), _floats("light", light)
    if transfer == "linear":
        return light
    with np.errstate(over="ignore"):  # becomes infinity
        if transfer == "srgb":
            from rsdeblur.kernels.tone import to_srgb  # loads Numba, which checks of options need not wait for

            return to_srgb(np.asarray(light, dtype=np.float32, order="C"))[0]
        return np.copysign(np.abs(light) ** (1.0 / transfer), light).astype(np.float32)


def _floats(name: str, values: ArrayLike) -> NDArray[Any]:
    """Return values as an array, which may be the same; integers of pictures are refused, because they mean up to 1."""
    array = validate.array(name, values)
    if array.dtype.kind == "u":
        raise InputError(f"{name} must be floats, got {array.dtype}; divide them by {np.iinfo(array.dtype).max} before")
    return array


def normalized(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return overshooting light squeezed into [0, 1]: outliers are clipped and the rest is scaled, with less contrast.

    This is the optional last step of Sindelar and Sroubek (2013). It helps where large blurs of bright scenes ring
    beyond the range. Light that is in the range, except for outliers, is only clipped.
    """
    low, high = np.quantile(light, [OUTLIERS, 1.0 - OUTLIERS])
    low, high = min(float(low), 0.0), max(float(high), 1.0)
    return ((light - np.float32(low)) / np.float32(high - low)).clip(0.0, 1.0)


def as_float(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return encoded values as float32, integers divided by their full scale."""
    with np.errstate(over="ignore", invalid="ignore"):  # infinity, or a signalling NaN: refused
        scaled = values.astype(np.float32)
    if values.dtype.kind == "u":
        scaled /= np.iinfo(values.dtype).max
    return scaled


def as_stored(values: NDArray[np.float32], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return values in [0, 1] as `dtype`; integers are rounded."""
    if dtype.kind != "u":
        return values
    rounded: NDArray[Any] = np.rint(values * np.float32(np.iinfo(dtype).max)).astype(dtype)
    return rounded


def quantised(image: NDArray[Any], bits: int) -> NDArray[Any]:
    """Return values in [0, 1] as samples of `bits` bits; 32 is float32."""
    if image.dtype.kind == "u" and 8 * image.dtype.itemsize == bits:
        return image
    values = as_float(image)
    return values if bits == 32 else as_stored(values.clip(0.0, 1.0), np.dtype(f"u{bits // 8}"))


def linear_profile() -> bytes:
    """Return an ICC profile (version 2.1) with sRGB's primaries and linear values."""

    def fixed(*numbers: float) -> bytes:
        return b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(number * 65536)) for number in numbers)

    name = b"linear sRGB"
    description = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name + b"\0" * 79
    # Primaries adapted to D50 (Bradford), as in the profiles of sRGB; an empty curve is the identity.
    tags = {
        b"desc": description,
        b"cprt": b"text\0\0\0\0public domain\0",
        b"wtpt": fixed(0.9642, 1.0, 0.8249),
        b"rXYZ": fixed(0.43607, 0.22249, 0.01392),
        b"gXYZ": fixed(0.38515, 0.71687, 0.09708),
        b"bXYZ": fixed(0.14307, 0.06061, 0.71410),
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), b"curv\0\0\0\0" + struct.pack(">I", 0)),
    }
    table, body = struct.pack(">I", len(tags)), b""
    start = 128 + 4 + 12 * len(tags)
    for key, value in tags.items():
        table += key + struct.pack(">II", start + len(body), len(value))
        body += value + b"\0" * (-len(value) % 4)
    size = start + len(body)
    header = struct.pack(">I4sI", size, b"\0" * 4, 0x02100000) + b"mntrRGB XYZ "
    header = header.ljust(36, b"\0") + b"acsp"
    header = header.ljust(68, b"\0") + struct.pack(">3i", *(round(v * 65536) for v in (0.9642, 1.0, 0.8249)))
    return header.ljust(128, b"\0") + table + body
