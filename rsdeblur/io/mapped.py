"""Pictures that stay in their files: NumPy's own format and uncompressed TIFF, read and written through memory maps.

Mapped samples occupy memory only after they are touched, and the system may reclaim it at any time.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any, BinaryIO

import numpy as np
import tifffile
from numpy.typing import NDArray

from rsdeblur._util.atomic import reserve
from rsdeblur.io import _tiff, untrusted
from rsdeblur.io._metadata import Metadata, of_tiff

NPY_MAGIC = b"\x93NUMPY"
SUFFIXES = (".npy", ".tif", ".tiff")

Mapped = tuple[NDArray[Any], Metadata]


def map_picture(file: BinaryIO, max_pixels: int) -> Mapped | None:
    """Return the samples of `file` as a read-only map, and its metadata; None if they must be decoded."""
    head = file.read(len(NPY_MAGIC))
    file.seek(0)
    size = os.fstat(file.fileno()).st_size
    if head == NPY_MAGIC:
        return np.memmap(file, mode="r", **npy_place(file, size, max_pixels)), Metadata()
    if not head.startswith(_tiff.MAGIC):
        return None
    untrusted.check("TIFF", "tifffile")
    with tifffile.TiffFile(file) as tiff:
        page = _tiff.first_page(tiff)
        place = _tiff.place(page, size)
        if place is None:
            return None
        file.seek(0)
        metadata = of_tiff(page, *_tiff.exif_block(file))
    return np.memmap(file, mode="r", **place), metadata


def npy_place(file: BinaryIO, size: int, max_pixels: int) -> dict[str, Any]:
    """Return offset, dtype and shape of the samples in a NumPy file of `size` bytes."""
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read_header(file)
    is_picture = len(shape) in (2, 3) and all(shape) and (len(shape) == 2 or shape[2] in (2, 3, 4))
    if not is_picture or fortran or dtype not in (np.uint8, np.uint16, np.float32):
        order = " in Fortran order" if fortran else ""
        raise _tiff.Unsupported(
            f"the array has shape {shape} and type {dtype}{order}; a picture is not empty, and has shape (H, W) "
            "or (H, W, C) with C = 2, 3 or 4 and type uint8, uint16 or float32, in C order"
        )
    if shape[0] * shape[1] > max_pixels:
        raise _tiff.Unsupported(f"the picture claims {shape[1]}x{shape[0]} pixels; the limit is {max_pixels}")
    offset = file.tell()
    if offset + int(np.prod(shape)) * dtype.itemsize > size:
        raise EOFError("the file ends within the samples")
    return {"offset": offset, "dtype": dtype, "shape": shape}


def decode_npy(data: bytes, max_pixels: int) -> NDArray[Any]:
    """Return the samples of a NumPy file; errors as for :func:`npy_place`."""
    place = npy_place(BytesIO(data), len(data), max_pixels)
    return np.ndarray(buffer=data, **place).copy()


@contextmanager
def mapped_samples(
    file: BinaryIO, suffix: str, shape: tuple[int, ...], dtype: np.dtype[Any], metadata: Metadata
) -> Iterator[NDArray[Any]]:
    """Write a picture of zeros into an empty `file`, open for reading and writing, and yield its mapped samples."""
    if suffix == ".npy":
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(file, header)
        offset = file.tell()
        file.truncate(offset + int(np.prod(shape)) * dtype.itemsize)
    else:
        offset = _tiff.write_empty(file, shape, dtype, metadata)
    reserve(file)
    samples = np.memmap(file, dtype, "r+", offset, shape)
    yield samples
    samples.flush()
