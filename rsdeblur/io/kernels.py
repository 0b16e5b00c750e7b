"""PSFs from files: a bank, an array, or the picture of a kernel."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.files import open_file
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io.pictures import read_picture
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

BANK, ARRAY = b"PK", b"\x93NUMPY"


def read_psfs(path: str | os.PathLike[str], shape: tuple[int, ...]) -> PsfBank:
    """Read the PSFs of a picture."""
    with open_file(path, "PSF") as file:
        start = file.read(len(ARRAY))
        if start.startswith(BANK):
            return PsfBank.load(path)
        if start == ARRAY:
            file.seek(0)
            try:
                values = _checked(np.load(file, allow_pickle=False))
            except Exception as error:  # NumPy's header parser raises many kinds on damaged files
                raise FileFormatError(f"{path}: not an array of PSFs: {error}") from error
        else:
            pixels = read_picture(path).pixels
            try:
                values = _grey(_checked(pixels))
            except InputError as error:
                raise FileFormatError(f"{path}: not the picture of a PSF: {error}") from error
    if values.ndim not in (2, 4) or values.size == 0:
        raise FileFormatError(f"{path}: a PSF has shape (kh, kw), PSFs have (B, S, kh, kw), found {values.shape}")
    sums = values.sum(axis=(-2, -1), keepdims=True)
    if not (sums > 0).all():  # not a number, too
        raise FileFormatError(f"{path}: the sum of a PSF must be positive, found {sums.min():g}")
    odd = [(0, 0)] * (values.ndim - 2) + [(0, 1 - n % 2) for n in values.shape[-2:]]
    try:
        return PsfBank.for_picture(np.pad(values / sums, odd), shape)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _checked(values: ArrayLike) -> FloatArray:
    return validate.real_array("values", values, most=validate.MOST_LIGHT)


def _grey(pixels: FloatArray) -> FloatArray:
    """Return the mean of the colours, without alpha."""
    if pixels.ndim == 2:
        return pixels
    colours = pixels.shape[2] - (pixels.shape[2] in (2, 4))
    mean: FloatArray = pixels[:, :, :colours].mean(axis=2)
    return mean
