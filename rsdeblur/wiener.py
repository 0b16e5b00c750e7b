"""The Wiener filter, global and banded, in the hybrid domain.

Rows are transformed once for all bands; along y each band is a slab with its own filter; slabs are blended before the
one inverse row transform. `global` is the case of one band and one strip, not another code path.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur import _validate
from rsdeblur.border import BORDERS, Border, extend
from rsdeblur.errors import InputError
from rsdeblur.fft import PLANNINGS, ColumnTransform, Complex, Planning, RowTransform, thread_count
from rsdeblur.kernels import spectral
from rsdeblur.psf import PsfBank
from rsdeblur.tiling import Tile, Tiling

# The inverse filter of a straight PSF of K px at NSR Phi rings with a decay length of K / (2 pi sqrt(Phi)): its poles
# stand that far off the real axis. A tile that sees 0.1 K / sqrt(Phi) beyond its part, some 0.6 decay lengths, was
# within 0.15 dB of one that sees everything (docs/developer/decisions.md); less than half a PSF never suffices.
DECAY_MARGIN = 0.1
LEAST_MARGIN = 0.5


class Deconvolver:
    """Wiener deconvolution with a bank of PSFs, planned once and applied often.

    Each tile is filtered with

        U = (1 + nsr) conj(H) / (|H|^2 + nsr) G

    which is eq. 7 of Sindelar and Sroubek (2013) times (1 + nsr): a constant picture keeps its brightness and no
    motion is the identity at any `nsr`.

    Parameters
    ----------
    bank : PsfBank
        B x S kernels; 1 x 1 is the global mode.
    shape : (H, W) or (H, W, C)
        Shape of the pictures to come.
    nsr : float, default 0.01
        Noise-to-signal power ratio Phi, positive.
    border : {"blend", "periodic"}
        "blend" continues the picture and fades opposite borders into each other over the PSF's size; "periodic" takes
        the picture as repeating.
    planning : {"estimate", "measure"}
        How FFTW plans: at once, or by trying out (some seconds, for plans that are applied often).
    threads : int, optional
        Threads for the transforms; default all processors.

    Raises
    ------
    InputError
        If a kernel is larger than the picture or an argument is out of range.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.01,
        border: Border = "blend",
        planning: Planning = "estimate",
        threads: int | None = None,
    ) -> None:
        self.shape = _picture_shape(shape)
        self.nsr = _validate.finite("nsr", nsr, above=0.0)
        _validate.choice("border", border, BORDERS)
        _validate.choice("planning", planning, PLANNINGS)
        self.border = border
        height, width = self.shape[:2]
        _check_fit(bank, height, width)
        threads = thread_count(threads)
        periodic = border == "periodic"
        reach = max(LEAST_MARGIN, DECAY_MARGIN / self.nsr**0.5)
        self._bands, self._strips = (
            Tiling.plan(centres, n, kernel, int(np.ceil(reach * kernel)), periodic=periodic)
            for centres, n, kernel in zip((bank.rows, bank.cols), (height, width), bank.size, strict=True)
        )
        channels = self.shape[2] if len(self.shape) == 3 else 1
        self._rows = RowTransform((channels, height, self._strips.length), threads, planning)
        self._slab = ColumnTransform((channels, self._bands.length, self._strips.length // 2 + 1), threads, planning)
        self._filters = self._plan_filters(bank, threads)
        self._lock = threading.Lock()

    def apply(
        self,
        image: ArrayLike,
        out: NDArray[np.float32] | None = None,
        *,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur one picture.

        Parameters
        ----------
        image : array_like of the planned shape
            Linear light; converted to float32.
        out : ndarray, float32, optional
            Receives the result; may be `image` itself.
        progress : callable, optional
            Called with the finished fraction after each strip.

        Returns
        -------
        ndarray, float32
            `out`, or a new array; not clipped.

        Raises
        ------
        InputError
            If `image` or `out` has another shape or type, or `image` is not finite.
        """
        picture = np.asarray(image, dtype=np.float32)
        if picture.shape != self.shape:
            raise InputError(f"image must have the planned shape {self.shape}, got {picture.shape}")
        if not np.isfinite(picture).all():
            raise InputError("image must be finite")
        if out is None:
            out = np.empty(self.shape, dtype=np.float32)
        elif out.shape != self.shape or out.dtype != np.float32:
            raise InputError(f"out must be float32 of shape {self.shape}, got {out.dtype} of shape {out.shape}")
        planes = np.ascontiguousarray(np.moveaxis(np.atleast_3d(picture), -1, 0))
        result = np.zeros_like(planes)
        with self._lock:
            for s, strip in enumerate(self._strips.tiles):
                self._apply_strip(planes, result, s, strip)
                if progress is not None:
                    progress((s + 1) / len(self._strips.tiles))
        out[...] = np.moveaxis(result, 0, -1).reshape(self.shape)
        return out

    def _apply_strip(self, planes: NDArray[np.float32], result: NDArray[np.float32], s: int, strip: Tile) -> None:
        rows, slab = self._rows, self._slab
        extend(planes, rows.real, strip.start, taper=self._strips.taper, border=self.border, axis=-1)
        rows.forward()
        blended = np.zeros_like(rows.spectrum)
        for b, band in enumerate(self._bands.tiles):
            extend(rows.spectrum, slab.data, band.start, taper=self._bands.taper, border=self.border, axis=-2)
            slab.forward()
            spectral.multiply(slab.data, self._filters[b, s])
            slab.inverse()
            spectral.blend(blended, slab.data, band.weights, to_row=band.first, from_row=band.first - band.start)
        rows.spectrum[...] = blended
        rows.inverse()
        offset, n = strip.first - strip.start, len(strip.weights)
        result[:, :, strip.first : strip.first + n] += strip.weights * rows.real[:, :, offset : offset + n]

    def _plan_filters(self, bank: PsfBank, threads: int) -> Complex:
        """Return the filters of all tiles, shape (B, S, L, K), with the scaling of the inverse transforms folded in."""
        length, width = self._bands.length, self._strips.length
        rows = RowTransform((1, length, width), threads)
        columns = ColumnTransform((1, length, width // 2 + 1), threads)
        filters: Complex = np.empty((*bank.kernels.shape[:2], *columns.data.shape[1:]), dtype=np.complex64)
        scale = np.float32((1.0 + self.nsr) / (length * width))
        for tile in np.ndindex(*bank.kernels.shape[:2]):
            _centre_at_origin(bank.kernels[tile], rows.real[0])
            rows.forward()
            columns.data[...] = rows.spectrum
            columns.forward()
            otf = columns.data[0]
            power = otf.real**2 + otf.imag**2
            np.multiply(otf.conj(), scale / (power + np.float32(self.nsr)), out=filters[tile])
        return filters


def _centre_at_origin(kernel: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Place `kernel` in `out` with its centre at (0, 0), wrapped around."""
    out[...] = 0.0
    i, j = (np.arange(n) - n // 2 for n in kernel.shape)
    out[np.ix_(i % out.shape[0], j % out.shape[1])] = kernel


def _picture_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    if len(shape) not in (2, 3):
        raise InputError(f"shape must be (H, W) or (H, W, C), got {shape}")
    return tuple(_validate.count("shape", n) for n in shape)


def _check_fit(bank: PsfBank, height: int, width: int) -> None:
    kernel_height, kernel_width = bank.size
    if kernel_height > height or kernel_width > width:
        raise InputError(
            f"the PSF of {kernel_width}x{kernel_height} px is larger than the picture of {width}x{height} px; "
            "are the rates in rad/s, the focal length in px and the exposure in s?"
        )
