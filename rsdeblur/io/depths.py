"""Maps of depths from files."""

from __future__ import annotations

import os

import numpy as np
from scipy import ndimage

from rsdeblur._util.files import open_file
from rsdeblur.errors import FileFormatError
from rsdeblur.io.kernels import ARRAY
from rsdeblur.io.pictures import read_picture
from rsdeblur.types import FloatArray

MILLIMETRE = 1e-3


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
    ...     rsdeblur.read_depths(f"{folder}/depth.npy")
    array([[0.9, 0.9],
           [2.5, 2.5]])
    """
    with open_file(path, "depth map") as file:
        if file.read(len(ARRAY)) == ARRAY:
            file.seek(0)
            try:
                stored = np.load(file, allow_pickle=False)
            except Exception as error:  # NumPy's header parser raises many kinds on damaged files
                raise FileFormatError(f"{path}: not an array of depths: {error}") from error
        else:
            stored = read_picture(path).pixels
    if stored.dtype.kind not in "uif" or stored.dtype.itemsize < 2:
        raise FileFormatError(f"{path}: depths are floats in m or whole numbers of 16 bits in mm, found {stored.dtype}")
    if stored.ndim == 3 and stored.shape[2] == 1:
        stored = stored[:, :, 0]
    if stored.ndim != 2:
        raise FileFormatError(f"{path}: a map of depths has shape (R, C), found {stored.shape}")
    depths = stored.astype(np.float64) * (1.0 if stored.dtype.kind == "f" else MILLIMETRE)
    known = np.isfinite(depths) & (depths != 0)
    if not known.any() or depths[known].min() < 0:
        found = f"{depths[known].min():g} m" if known.any() else "none"
        raise FileFormatError(f"{path}: depths must be positive, found {found}")
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    filled: FloatArray = depths[tuple(nearest)]
    return filled
