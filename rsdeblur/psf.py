"""The PSF bank: one kernel for each tile of a grid of bands x strips."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import affine_transform, gaussian_filter

from rsdeblur._util import validate
from rsdeblur._util.files import atomic_write, open_file
from rsdeblur._util.one_line import html_with_pictures, one_line
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.types import FloatArray

# Parts of a pixel along x and y in which parametric kernels are drawn, odd: up to this reach in px, and beyond it.
LARGE, PARTS, PARTS_OF_LARGE = 60, 7, 3


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class PsfBank:
    """PSFs on a grid of B bands x S strips.

    A PSF h is the kernel of the convolution `g = h * u`: `h[i, j]` is the weight of the displacement
    (i - kh // 2, j - kw // 2), in rows and columns, from a point of the sharp picture u to a point of the blurred
    picture g. The origin is the centre of the kernel.

    Parameters
    ----------
    kernels : array_like, shape (B, S, kh, kw), or (B, kh, kw), or (kh, kw)
        Odd sizes; each kernel sums to 1, and deviations of up to 1e-3 are normalised. The attribute is float32 and has
        four axes.
    rows : array_like, shape (B,)
        Picture rows in px, increasing, at which the kernels are exact; results are blended between them.
    cols : array_like, shape (S,)
        The same for columns.
    displacements : array_like, shape (B, S, T, 2), optional
        Paths that the kernels draw, see :class:`BlurPaths`. Solvers of tiles then undo the paths themselves, because
        kernels on pixels are less accurate.
    softness : float, default 0.0
        Standard deviation in px, from 0 to 1, of the Gaussian that the kernels contain besides the paths; 0 without
        paths.

    Raises
    ------
    InputError
        If a size is even, a value is not finite, a sum is not 1, `rows`, `cols` or `displacements` do not match the
        kernels, or `rows` or `cols` do not increase.

    See Also
    --------
    PsfBank.for_picture : Bank of kernels spread evenly over a picture.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> rsdeblur.PsfBank.for_picture(np.full((1, 5), 0.2), (480, 640))
    PsfBank(kernels=float32[1, 1, 1, 5], rows=[239.5], cols=[319.5])
    """

    kernels: NDArray[np.float32]
    rows: FloatArray
    cols: FloatArray
    displacements: FloatArray | None = None
    softness: float = 0.0

    def __post_init__(self) -> None:
        kernels = _kernels(self.kernels)
        object.__setattr__(self, "kernels", kernels)
        for axis, name in enumerate(("rows", "cols")):
            centres = validate.real_array(name, getattr(self, name), (kernels.shape[axis],))
            validate.increasing(name, centres)
            object.__setattr__(self, name, centres)
        object.__setattr__(self, "softness", validate.softness("softness", self.softness))
        if self.displacements is not None:
            displacements = validate.real_array("displacements", self.displacements)
            object.__setattr__(self, "displacements", displacements)
            down, across = BlurPaths(displacements, self.rows, self.cols).extent
            if down > kernels.shape[2] // 2 or across > kernels.shape[3] // 2:
                raise InputError("displacements must lie within the kernels that draw them")
        if self.displacements is None and self.softness > 0:
            raise InputError("softness belongs to displacements; kernels without them contain all of the blur")

    @classmethod
    def from_paths(cls, paths: BlurPaths, *, threads: int | None = None) -> PsfBank:
        """Return the bank of the PSFs of paths.

        Parameters
        ----------
        paths : BlurPaths
            Paths, along which the energy is spread evenly in time. The largest displacement sets the size of the
            kernels.
        threads : int, optional
            Number of threads that share the work; default all processors. Any number gives the same bits.
        """
        validate.instance("paths", paths, BlurPaths)
        # Bilinear weights reach the pixel beyond the last one; kernels are cut off where the Gaussian is.
        height, width = (2 * (int(np.floor(reach)) + 1) + 1 for reach in paths.extent)
        bands, strips, samples, _ = paths.displacements.shape
        validate.memory(f"{bands} x {strips} PSFs of {width}x{height} px", 4 * bands * strips * height * width, 0)
        flat = np.ascontiguousarray(paths.displacements.reshape(bands * strips, samples, 2))
        kernels = rasterize(flat, height // 2, width // 2, threads).reshape(bands, strips, height, width)
        if paths.softness > 0:
            radius = int(np.ceil(3 * paths.softness))
            kernels = gaussian_filter(kernels, paths.softness, mode="constant", radius=radius, axes=(2, 3))
        return cls(kernels, paths.rows, paths.cols, paths.displacements, paths.softness)

    @classmethod
    def for_picture(cls, kernels: ArrayLike, shape: tuple[int, ...]) -> PsfBank:
        """Return the bank of kernels for equal tiles of a picture.

        Parameters
        ----------
        kernels : array_like, shape (B, S, kh, kw), or (B, kh, kw), or (kh, kw)
            See :class:`PsfBank`. Each may have any positive sum, by which it is divided, and any size: an even one gets
            a row or column of zeros at its end.
        shape : tuple of int
            Shape of the picture, (H, W) or (H, W, C). The kernels are exact at the centres of B x S equal tiles.

        Raises
        ------
        InputError
            If the kernels are invalid, see :class:`PsfBank`, or `shape` is not 2 or 3 whole numbers of at least 1.
        """
        values, (height, width, *_) = validate.real_array("kernels", kernels), validate.shape(shape)
        if values.ndim >= 2 and values.size:
            sums = values.sum(axis=(-2, -1), keepdims=True)
            if not (sums > 0).all():  # not a number, too
                raise InputError(f"the sum of a PSF must be positive, found {sums.min():g}")
            odd = [(0, 0)] * (values.ndim - 2) + [(0, 1 - n % 2) for n in values.shape[-2:]]
            values = np.pad(values / sums, odd)
        grid = _kernels(values)
        return cls(grid, tile_centres(grid.shape[0], height), tile_centres(grid.shape[1], width))

    @classmethod
    def from_field(cls, u: ArrayLike, v: ArrayLike, *, tile: int = 32) -> PsfBank:
        """Return the bank of a field of straight blurs, a line for each pixel, as networks estimate it.

        Parameters
        ----------
        u, v : array_like, shape (H, W)
            Length of the blur of each pixel along x and along y, px. A line has no sign, so (u, v) and (-u, -v) are the
            same.
        tile : int, default 32
            Side of the tiles, px, over which lines are averaged: lengths, and double angles.

        Raises
        ------
        InputError
            If a value is not finite, the shapes differ, or `tile` is less than 1.
        """
        across = validate.real_array("u", u)
        lines = across + 1j * validate.real_array("v", v, across.shape)
        height, width = validate.shape(across.shape)
        side = validate.count("tile", tile, maximum=validate.MOST_VALUES)
        bands, strips = -(-height // side), -(-width // side)
        starts = [np.arange(tiles) * length // tiles for tiles, length in ((bands, height), (strips, width))]

        def sums(values: NDArray[Any]) -> NDArray[Any]:
            return np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)

        lengths = sums(np.abs(lines)) / sums(np.ones(lines.shape))
        mean = lengths * np.exp(0.5j * np.angle(sums(lines**2)))
        ends = np.stack([mean.real, mean.imag], axis=-1)
        moments = np.linspace(-0.5, 0.5, 129)[:, None]
        paths = BlurPaths(moments * ends[:, :, None], tile_centres(bands, height), tile_centres(strips, width))
        return cls.from_paths(paths)

    @classmethod
    def parametric(cls, *, line: tuple[float, float] = (0.0, 0.0), disc: float = 0.0, gauss: float = 0.0) -> PsfBank:
        """Return the bank of one kernel for the whole picture: a line, a disc and a Gaussian, convolved.

        Parameters
        ----------
        line : (float, float)
            Straight motion: its length in px, from 0 to 300, and its angle in degrees, counter-clockwise from x.
        disc : float
            Defocus: diameter of a disc in px, from 0 to 200.
        gauss : float
            Standard deviation of a Gaussian in px, from 0 to 30.

        Returns
        -------
        PsfBank
            Its kernel is integrated over each pixel, and centred. It belongs to any size of picture.

        Examples
        --------
        >>> import rsdeblur
        >>> rsdeblur.PsfBank.parametric(line=(12, 30), disc=4, gauss=1.2).size
        (21, 25)
        """
        from scipy.signal import fftconvolve  # takes 0.5 s to import, which other kernels need not spend

        length, angle = validate.real_array("line", line, (2,))
        length = validate.finite("the length of line", float(length), minimum=0.0, maximum=300.0)
        disc = validate.finite("disc", disc, minimum=0.0, maximum=200.0)
        gauss = validate.finite("gauss", gauss, minimum=0.0, maximum=30.0)
        end = length / 2 * np.array([np.cos(np.deg2rad(angle)), -np.sin(np.deg2rad(angle))])
        reach = np.ceil(np.abs(end) + disc / 2 + 4 * gauss).astype(int)
        n = PARTS if reach.max() <= LARGE else PARTS_OF_LARGE
        x, y = (np.arange(-side, side + 1) for side in (n * reach + n // 2))
        path = np.ascontiguousarray(n * np.stack([-end, end])[None])
        drawn = rasterize(path, len(y) // 2, len(x) // 2, None)[0].astype(np.float64)
        if disc > 0:  # its rim covers parts in part
            round_part = np.clip(n * disc / 2 - np.hypot(x, y[:, None]) + 0.5, 0.0, 1.0)
            drawn = fftconvolve(drawn, round_part, mode="same").clip(0.0, None)
        drawn = gaussian_filter(drawn, n * gauss, mode="constant")
        kernel = drawn.reshape(len(y) // n, n, len(x) // n, n).sum(axis=(1, 3))
        return cls(kernel / kernel.sum(), np.zeros(1), np.zeros(1))

    @property
    def centres(self) -> FloatArray:
        """Positions (row, column) in px at which the kernels are exact, shape (B, S, 2)."""
        return np.stack(np.meshgrid(self.rows, self.cols, indexing="ij"), axis=-1)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the kernels in px."""
        return self.kernels.shape[2], self.kernels.shape[3]

    def at(self, y: float, x: float) -> NDArray[np.float32]:
        """Return the PSF at a point of the picture, interpolated between the four nearest kernels.

        Beyond the outermost kernels it is constant, as it is for the solvers.

        Parameters
        ----------
        y, x : float
            Row and column in px.

        Returns
        -------
        ndarray, shape (kh, kw), float32
            The kernel; its sum is 1.

        Raises
        ------
        InputError
            If `y` or `x` is not a finite number.

        Examples
        --------
        >>> import rsdeblur
        >>> still, moving = [[0, 0, 1, 0, 0]], [[0.2, 0.2, 0.2, 0.2, 0.2]]
        >>> bank = rsdeblur.PsfBank([[still], [moving]], rows=[100, 300], cols=[320])
        >>> bank.at(200, 320)
        array([[0.1, 0.1, 0.6, 0.1, 0.1]], dtype=float32)
        """
        weights = [
            np.array([np.interp(validate.finite(name, place), centres, unit) for unit in np.eye(len(centres))])
            for name, place, centres in (("y", y, self.rows), ("x", x, self.cols))
        ]
        kernel: FloatArray = np.einsum("b,s,bsij->ij", *weights, self.kernels, dtype=np.float64)
        return kernel.astype(np.float32)

    def _repr_html_(self) -> str:
        """Return the representation and the kernels for a notebook."""
        return html_with_pictures(self, {"kernels": kernel_sheet(self)})

    def padded(self, size: tuple[int, int]) -> PsfBank:
        """Return the bank with kernels surrounded by zeros.

        Parameters
        ----------
        size : (int, int)
            Height and width of the kernels in px, odd, at least their own.

        Raises
        ------
        InputError
            If `size` is even or smaller.
        """
        wanted = validate.real_array("size", size, (2,), most=validate.MOST_VALUES)
        if (wanted < self.size).any() or (wanted % 2 != 1).any():
            raise InputError(f"size must be two odd numbers of at least {self.size}, got {size}")
        height, width = map(int, wanted)
        validate.memory(f"PSFs of {width}x{height} px", 4 * self.kernels[..., 0, 0].size * height * width, 0)
        down, across = ((n - own) // 2 for n, own in zip((height, width), self.size, strict=True))
        return replace(self, kernels=np.pad(self.kernels, ((0, 0), (0, 0), (down, down), (across, across))))

    def without_softness(self) -> PsfBank:
        """Return the bank of the motion alone."""
        if self.displacements is None or self.softness == 0:
            return self
        return PsfBank.from_paths(BlurPaths(self.displacements, self.rows, self.cols))

    def scaled(self, factor: float) -> PsfBank:
        """Return the bank of a blur of another size at the same places, whose softness beside paths stays as it is.

        Parameters
        ----------
        factor : float
            Its size over that of this one, from 0.001 to 10. Kernels without paths are interpolated.
        """
        factor = validate.finite("factor", factor, minimum=0.001, maximum=10.0)
        if self.displacements is not None:
            return PsfBank.from_paths(BlurPaths(factor * self.displacements, self.rows, self.cols, self.softness))
        size = [2 * int(np.ceil(factor * (n // 2))) + 1 for n in self.size]
        validate.memory(f"PSFs of {size[1]}x{size[0]} px", 4 * self.kernels[..., 0, 0].size * size[0] * size[1], 0)
        # Pixels of a smaller kernel are as wide as several.
        softer = gaussian_filter(self.kernels, np.sqrt(max(factor**-2 - 1, 0.0)) / 2, mode="constant", axes=(2, 3))
        places = [n // 2 - m // 2 / factor for n, m in zip(self.size, size, strict=True)]
        shape, step = (*self.kernels.shape[:2], *size), np.diag([1, 1, 1 / factor, 1 / factor])
        drawn = affine_transform(softer, step, [0, 0, *places], output_shape=shape, order=1, mode="grid-constant")
        return PsfBank(drawn / drawn.sum(axis=(2, 3), keepdims=True), self.rows, self.cols)

    def cut(self, rows: slice, cols: slice) -> PsfBank:
        """Return the bank of the kernels that affect a part of the picture.

        Parameters
        ----------
        rows, cols : slice
            Rows and columns of the part in px, with a start and a stop.

        Returns
        -------
        PsfBank
            Its positions count from the first row and column of the part. The outermost may lie outside.
        """
        for name, part in (("rows", rows), ("cols", cols)):
            validate.instance(name, part, slice)
            for end in ("start", "stop"):
                validate.finite(f"the {end} of {name}", getattr(part, end))
        bands, strips = affecting(self.rows, rows), affecting(self.cols, cols)
        paths = None if self.displacements is None else self.displacements[bands, strips]
        places = self.rows[bands] - rows.start, self.cols[strips] - cols.start
        return PsfBank(self.kernels[bands, strips], *places, paths, self.softness)

    def turned(self, height: int) -> PsfBank:
        """Return the bank of the picture turned a quarter counter-clockwise (`numpy.rot90(picture)`).

        Parameters
        ----------
        height : int
            Height of the turned picture in px. Its rows are the old columns, counted from the right.

        Returns
        -------
        PsfBank
            Bank with turned kernels and positions.
        """
        height = validate.count("height", height, maximum=validate.MOST_VALUES)
        kernels = np.rot90(np.rot90(self.kernels, axes=(0, 1)), axes=(2, 3))
        paths = self.displacements
        if paths is not None:
            # A step to the right becomes one upwards, a step down one to the right.
            paths = np.rot90(paths, axes=(0, 1))[..., ::-1] * (1, -1)
        return PsfBank(kernels, (height - 1 - self.cols)[::-1], self.rows, paths, self.softness)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the bank as a compressed NumPy archive; the file is replaced atomically.

        Parameters
        ----------
        path : path-like
            The file.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        with atomic_write(path) as file:
            np.savez_compressed(file, **{name: array for name, array in arrays.items() if array is not None})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PsfBank:
        """Read a bank written by :meth:`save`.

        Parameters
        ----------
        path : path-like
            The file.

        Raises
        ------
        FileFormatError
            If the file cannot be read or does not contain a valid bank.
        """
        with open_file(path, "PSF bank") as file:
            try:
                with np.load(file, allow_pickle=False) as archive:
                    paths, softness = archive.get("displacements"), float(archive.get("softness", 0.0))
                    return cls(archive["kernels"], archive["rows"], archive["cols"], paths, softness)
            except Exception as error:  # zipfile, zlib and NumPy's header parser raise many kinds on damaged files
                raise FileFormatError(f"{path}: not a PSF bank: {error}") from error


def kernel_sheet(bank: PsfBank) -> NDArray[np.float32]:
    """Return at most 12 x 12 kernels of a bank as one grey picture in [0, 1], framed, each with its peak white."""
    rows, cols = (-(-n // 12) for n in bank.kernels.shape[:2])  # at most 12 of each
    shown = np.pad(bank.kernels[rows // 2 :: rows, cols // 2 :: cols], ((0, 0), (0, 0), (1, 1), (1, 1)))
    shown = np.sqrt(np.clip(shown / shown.max(axis=(2, 3), keepdims=True), 0.0, 1.0))  # brightens faint parts
    shown[:, :, [0, -1]] = shown[..., [0, -1]] = 0.3  # grey frames
    sheet: NDArray[np.float32] = shown.transpose(0, 2, 1, 3).reshape(len(shown) * shown.shape[2], -1)
    return sheet


def tile_centres(tiles: int, length: int) -> FloatArray:
    """Return the centres in px of `tiles` equal parts of `length` pixels; pixel centres are at integers."""
    return (np.arange(tiles) + 0.5) * length / tiles - 0.5


def affecting(centres: FloatArray, part: slice) -> slice:
    """Return which of the PSFs at `centres` along an axis affect a part of the axis, a slice with start and stop."""
    return slice(
        max(int(np.searchsorted(centres, part.start, side="right")) - 1, 0),
        min(int(np.searchsorted(centres, part.stop - 1)), len(centres) - 1) + 1,
    )


def _kernels(value: ArrayLike) -> NDArray[np.float32]:
    kernels = validate.real_array("kernels", value, most=validate.MOST_LIGHT).astype(np.float32)
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
    # Users' kernels may be rounded to a few digits.
    if abs(worst - 1) > 1e-3:
        raise InputError(f"each kernel must sum to 1, found a sum of {worst:g}; divide each kernel by its sum")
    kernels /= sums[..., None, None].astype(np.float32)
    kernels.setflags(write=False)
    return kernels
