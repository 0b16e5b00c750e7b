"""Tone curves between encoded values and linear light, in which blur happens."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.choices import TRANSFERS, Auto, Transfer
from rsdeblur.errors import InputError

# Largest gamma, and its inverse the least: devices use 0.4 to 3, and 255 steps do not survive more.
MOST_GAMMA = 10.0


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

            return to_srgb(np.asarray(light, dtype=np.float32, order="C"))
        return np.copysign(np.abs(light) ** (1.0 / transfer), light).astype(np.float32)


def _floats(name: str, values: ArrayLike) -> NDArray[Any]:
    """Return values as an array, which may be the same; integers of pictures are refused, because they mean up to 1."""
    array = validate.array(name, values)
    if array.dtype.kind == "u":
        raise InputError(f"{name} must be floats, got {array.dtype}; divide them by {np.iinfo(array.dtype).max} before")
    return array


# Share of the values at either end that counts as outliers.
OUTLIERS = 1e-3


def normalized(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return overshooting light squeezed into [0, 1]: outliers are clipped and the rest is scaled, with less contrast.

    This is the optional last step of Sindelar and Sroubek (2013). It helps where large blurs of bright scenes ring
    beyond the range. Light that is in the range, except for outliers, is only clipped.
    """
    low, high = np.quantile(light, [OUTLIERS, 1.0 - OUTLIERS])
    low, high = min(float(low), 0.0), max(float(high), 1.0)
    squeezed: NDArray[np.float32] = ((light - np.float32(low)) / np.float32(high - low)).clip(0.0, 1.0)
    return squeezed
