"""PSFs and maps of depths, from NumPy files and pictures."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.files import open_file
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io.pictures import NPY_MAGIC, read_picture
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray


def read_psfs(path: str | os.PathLike[str], shape: tuple[int, ...]) -> PsfBank:
    """Read the PSFs of a picture."""
    with open_file(path, "PSF") as file:
        if file.read(2) == b"PK":
            return PsfBank.load(path)
    stored, is_picture = _array_or_picture(path, "PSF")
    try:
        values = validate.real_array("values", stored, most=validate.MOST_LIGHT)
    except InputError as error:
        kind = "the picture of a PSF" if is_picture else "an array of PSFs"
        raise FileFormatError(f"{path}: not {kind}: {error}") from error
    if is_picture:
        values = _grey(values)
    if values.ndim not in (2, 4) or values.size == 0:
        raise FileFormatError(f"{path}: a PSF has shape (kh, kw), PSFs have (B, S, kh, kw), found {values.shape}")
    try:
        return PsfBank.for_picture(values, shape)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _grey(pixels: FloatArray) -> FloatArray:
    """Return the mean of the colours, without alpha."""
    if pixels.ndim == 2:
        return pixels
    colours = pixels.shape[2] - (pixels.shape[2] in (2, 4))
    mean: FloatArray = pixels[:, :, :colours].mean(axis=2)
    return mean


def read_depths(path: str | os.PathLike[str]) -> FloatArray:
    """Read a map of depths, as `depth` of :class:`rsdeblur.Translation` takes it.

    Parameters
    ----------
    path : path-like
        A NumPy file or a picture of one channel that spans the photo as stored, at any resolution. Floats are metres;
        whole numbers of 16 bits or more are millimetres, as depth cameras and the lidars of phones store them. Where a
        value is 0 or not a number, the depth is unknown.

    Returns
    -------
    ndarray, shape (R, C), float64
        Depths along the optical axis in m. An unknown depth is that of the nearest place that is known.

    Raises
    ------
    FileFormatError
        If the file cannot be read, has several channels or 8 bits, or contains a negative or no depth.

    Examples
    --------
    >>> import numpy as np, rsdeblur, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/depth.npy", np.array([[900, 0], [2500, 2500]], dtype=np.uint16))
    ...     rsdeblur.io.read_depths(f"{folder}/depth.npy")
    array([[0.9, 0.9],
           [2.5, 2.5]])
    """
    stored, _ = _array_or_picture(path, "depth map")
    if stored.dtype.kind not in "uif" or stored.dtype.itemsize < 2:
        raise FileFormatError(f"{path}: depths are floats in m or whole numbers of 16 bits in mm, found {stored.dtype}")
    if stored.ndim == 3 and stored.shape[2] == 1:
        stored = stored[:, :, 0]
    if stored.ndim != 2:
        raise FileFormatError(f"{path}: a map of depths has shape (R, C), found {stored.shape}")
    depths = stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else 1e-3)
    known = np.isfinite(depths) & (depths != 0)
    if not known.any() or depths[known].min() < 0:
        found = f"{depths[known].min():g} m" if known.any() else "none"
        raise FileFormatError(f"{path}: depths must be positive, found {found}")
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: FloatArray = depths[tuple(nearest)]
    return filled


def _array_or_picture(path: str | os.PathLike[str], what: str) -> tuple[NDArray[Any], bool]:
    """Return the values of a NumPy file or of a picture, and whether it is a picture."""
    with open_file(path, what) as file:
        if file.read(len(NPY_MAGIC)) != NPY_MAGIC:
            return read_picture(path).pixels, True
        file.seek(0)
        try:
            return np.load(file, allow_pickle=False), False
        except Exception as error:  # NumPy's header parser raises many kinds on damaged files
            raise FileFormatError(f"{path}: not an array of {what}s: {error}") from error
