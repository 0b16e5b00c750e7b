"""The PSF bank: one kernel for each tile of a grid of bands x strips."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import open_file
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.types import FloatArray

# Kernels given by a user may have been rounded to a few digits; a sum further from 1 is another quantity.
SUM_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class PsfBank:
    """PSFs on a grid of B bands x S strips.

    A PSF h is the kernel of `g = h * u`: `h[i, j]` weighs the displacement (i - kh // 2, j - kw // 2) from the sharp
    point to where it is recorded. The origin is the kernel's centre.

    Parameters
    ----------
    kernels : array_like, shape (B, S, kh, kw), or (B, kh, kw), or (kh, kw)
        Odd sizes; each kernel sums to 1 (a deviation up to 1e-3 is normalised away). Kept as float32 of four axes.
    rows : array_like, shape (B,)
        Picture rows, increasing, in px, at which the bands' kernels hold exactly; PSFs are blended between them.
    cols : array_like, shape (S,)
        Picture columns, increasing, in px, for the strips.

    Raises
    ------
    InputError
        If a size is even, a value is not finite, a sum is not 1, or `rows` or `cols` do not fit the kernels.

    See Also
    --------
    PsfBank.for_picture : for kernels spread evenly over a picture.
    """

    kernels: NDArray[np.float32]
    rows: FloatArray
    cols: FloatArray

    def __post_init__(self) -> None:
        kernels = _kernels(self.kernels)
        object.__setattr__(self, "kernels", kernels)
        for axis, name in enumerate(("rows", "cols")):
            centres = validate.real_array(name, getattr(self, name), (kernels.shape[axis],))
            if (np.diff(centres) <= 0).any():
                raise InputError(f"{name} must increase, got {centres.tolist()}")
            object.__setattr__(self, name, centres)

    @classmethod
    def from_paths(cls, paths: BlurPaths, *, threads: int | None = None) -> PsfBank:
        """Rasterise `paths`: energy even in time, kernel size from the longest reach, sum 1.

        `threads` share the work; the default is all processors, and any number gives the same bits.
        """
        # A splat needs the pixel beyond the last one touched.
        half_height, half_width = (int(np.floor(reach)) + 1 for reach in paths.extent)
        bands, strips, samples, _ = paths.displacements.shape
        flat = np.ascontiguousarray(paths.displacements.reshape(bands * strips, samples, 2))
        kernels = rasterize(flat, half_height, half_width, threads)
        return cls(kernels.reshape(bands, strips, *kernels.shape[1:]), paths.rows, paths.cols)

    @classmethod
    def for_picture(cls, kernels: ArrayLike, shape: tuple[int, ...]) -> PsfBank:
        """Place kernels at the centres of equal tiles of a picture of `shape` (H, W) or (H, W, C)."""
        grid = _kernels(kernels)
        if len(shape) not in (2, 3):
            raise InputError(f"shape must be (H, W) or (H, W, C), got {shape}")
        return cls(grid, tile_centres(grid.shape[0], shape[0]), tile_centres(grid.shape[1], shape[1]))

    @property
    def centres(self) -> FloatArray:
        """Where each kernel holds: (row, column) in px, shape (B, S, 2)."""
        return np.stack(np.meshgrid(self.rows, self.cols, indexing="ij"), axis=-1)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the kernels in px."""
        return self.kernels.shape[2], self.kernels.shape[3]

    def cut(self, rows: slice, cols: slice) -> PsfBank:
        """Return the kernels that hold somewhere in `rows` and `cols`; both have a start and a stop, px."""
        bands, strips = (
            slice(
                max(int(np.searchsorted(centres, part.start, side="right")) - 1, 0),
                min(int(np.searchsorted(centres, part.stop - 1)), len(centres) - 1) + 1,
            )
            for centres, part in ((self.rows, rows), (self.cols, cols))
        )
        return PsfBank(self.kernels[bands, strips], self.rows[bands], self.cols[strips])

    def turned(self, height: int) -> PsfBank:
        """Return the bank of the picture turned a quarter counter-clockwise (`numpy.rot90(picture)`).

        Parameters
        ----------
        height : int
            Height of the picture after turning, px: its rows are the old columns counted from the right.
        """
        kernels = np.rot90(np.rot90(self.kernels, axes=(0, 1)), axes=(2, 3))
        return PsfBank(kernels, (height - 1 - self.cols)[::-1], self.rows)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the bank as a compressed NumPy archive; the file is replaced atomically.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        with atomic_write(path) as file:
            np.savez_compressed(file, kernels=self.kernels, rows=self.rows, cols=self.cols)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PsfBank:
        """Read a bank written by :meth:`save`.

        Raises
        ------
        FileFormatError
            If the file cannot be read or does not hold a valid bank.
        """
        with open_file(path, "PSF bank") as file:
            try:
                with np.load(file, allow_pickle=False) as archive:
                    return cls(archive["kernels"], archive["rows"], archive["cols"])
            except Exception as error:  # zipfile, zlib and NumPy's header parser raise a dozen kinds on damaged files
                raise FileFormatError(f"{path}: not a PSF bank: {error}") from error


def tile_centres(tiles: int, length: int) -> FloatArray:
    """Centres, in px, of `tiles` equal parts of `length` pixels whose centres are at integers."""
    centres: FloatArray = (np.arange(tiles) + 0.5) * length / tiles - 0.5
    return centres


def _kernels(value: ArrayLike) -> NDArray[np.float32]:
    kernels = validate.real_array("kernels", value).astype(np.float32)
    if kernels.ndim not in (2, 3, 4) or kernels.size == 0:
        raise InputError(f"kernels must have shape (B, S, kh, kw), (B, kh, kw) or (kh, kw), got {kernels.shape}")
    if kernels.ndim < 4:
        kernels = kernels.reshape(-1, 1, *kernels.shape[-2:])
    height, width = kernels.shape[2:]
    if height % 2 == 0 or width % 2 == 0:
        raise InputError(
            f"kernels must have odd sizes, so that the centre is a pixel, got {height}x{width}; "
            "add a row or column of zeros"
        )
    sums = kernels.sum(axis=(2, 3), dtype=np.float64)
    worst = sums.flat[np.abs(sums - 1).argmax()]
    if abs(worst - 1) > SUM_TOLERANCE:
        raise InputError(f"each kernel must sum to 1, found a sum of {worst:g}; divide each kernel by its sum")
    kernels /= sums[..., None, None].astype(np.float32)
    kernels.setflags(write=False)
    return kernels
