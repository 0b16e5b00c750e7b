"""The blur of every row, its adjoint and the direct solve, for 16 frequencies at once: the C kernels and their twins.

A spectrum is kept as *lanes*, shape (B, C, R, 2, 16) float32: frequency 16 b + i of channel c and row r has its real
and imaginary part at [b, c, r, :, i]. The kernels work on one b; only a table of phases
differs from one to the next.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solveh_banded

from rsdeblur.kernels import native
from rsdeblur.kernels._jit import njit

Real = NDArray[np.float32]
Complex = NDArray[np.complex64]
Index = NDArray[np.int32]

# Frequencies to a block: floats in the widest vectors, and a cache line.
LANES = 16
# Latent rows are taken three at a time.
BLOCK = 3


class RowModel(NamedTuple):
    """The blur of every row as taps: `A[y, j] = sum of weight * phase(shift)` for picture row y and latent row j.

    Latent rows 3 J to 3 J + 2, block J, are seen by picture rows `row_first[J]` to `row_end[J] - 1` and by no other.
    The taps of every latent row j and row y in that range, j outermost, begin at the next value of `tap_start`;
    `coupled[J]` is the first block that shares a picture row, or a gradient, with block J. All int32 but the weights.
    """

    row_first: Index
    row_end: Index
    coupled: Index
    tap_start: Index
    tap_shift: Index
    tap_weight: Real

    @property
    def latents(self) -> int:
        """Number of latent rows."""
        return BLOCK * len(self.row_first)


def phase_table(block: int, first_shift: int, shifts: int, length: int) -> Real:
    """Return `exp(-2 pi i k s / length)` for the 16 frequencies k of `block` and shifts s; shape (shifts, 2, 16)."""
    k, s = LANES * block + np.arange(LANES), first_shift + np.arange(shifts)
    # Whole turns taken off before they cost digits.
    phases = np.exp(-2j * np.pi / length * (np.outer(s, k) % length))
    return np.stack([phases.real, phases.imag], axis=1).astype(np.float32)


@njit(nogil=True)
def spectra_to_lanes(spectra: Any, rows: Any, lanes: Any, top: Any) -> None:
    """Put the first `rows` of `spectra` (C, R, K) into rows `top` on of `lanes`."""
    channels, _, frequencies = spectra.shape
    for b in range(lanes.shape[0]):
        first = LANES * b
        n = min(LANES, frequencies - first)
        for c in range(channels):
            for r in range(rows):
                for i in range(n):
                    lanes[b, c, top + r, 0, i] = spectra[c, r, first + i].real
                    lanes[b, c, top + r, 1, i] = spectra[c, r, first + i].imag


@njit(nogil=True)
def lanes_to_spectra(lanes: Any, top: Any, spectra: Any, rows: Any) -> None:
    """Inverse of :func:`spectra_to_lanes`."""
    channels, _, frequencies = spectra.shape
    for b in range(lanes.shape[0]):
        first = LANES * b
        n = min(LANES, frequencies - first)
        for c in range(channels):
            for r in range(rows):
                for i in range(n):
                    spectra[c, r, first + i] = complex(lanes[b, c, top + r, 0, i], lanes[b, c, top + r, 1, i])


def spectra_to_lanes_numpy(spectra: Complex, rows: int, lanes: Real, top: int) -> None:
    """Readable twin of :func:`spectra_to_lanes`."""
    for b, block in enumerate(lanes):
        part = spectra[:, :rows, LANES * b : LANES * (b + 1)]
        for axis, values in enumerate((part.real, part.imag)):
            block[:, top : top + rows, axis, : part.shape[2]] = values


def lanes_to_spectra_numpy(lanes: Real, top: int, spectra: Complex, rows: int) -> None:
    """Readable twin of :func:`lanes_to_spectra`."""
    values = lanes[:, :, top : top + rows, 0] + 1j * lanes[:, :, top : top + rows, 1]
    whole = np.moveaxis(values, 0, 2).reshape(*values.shape[1:3], -1)
    spectra[:, :rows] = whole[..., : spectra.shape[2]]


def workspace_size_numpy(model: RowModel, table: Real, rows: int, solve: bool) -> int:
    """Return the floats of workspace that a kernel wants; the twins want none."""
    return 0


def forward_numpy(model: RowModel, table: Real, data: Real, latent: Real, workspace: Real) -> None:
    """Blur: `data = A latent`.

    Parameters
    ----------
    model : RowModel
    table : ndarray, shape (n, 2, 16), float32
        :func:`phase_table` of the block.
    data : ndarray, shape (C, H, 2, 16), float32
        Written.
    latent : ndarray, shape (C, L, 2, 16), float32
    workspace : ndarray, float32
        At least :func:`workspace_size` values.
    """
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        _store(data, lane, blur @ _load(latent, lane))


def adjoint_numpy(model: RowModel, table: Real, data: Real, latent: Real, workspace: Real) -> None:
    """Spread back: `latent = A^H data`; see :func:`forward_numpy`."""
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        _store(latent, lane, blur.conj().T @ _load(data, lane))


def solve_numpy(
    model: RowModel, table: Real, data: Real, latent: Real, workspace: Real, ridge: Real, smooth: float
) -> None:
    """Solve `(A^H A + diag(ridge) + smooth D^T D) u = A^H data + latent` in place of `latent`.

    Parameters
    ----------
    model, table, data, latent, workspace
        See :func:`forward_numpy`.
    ridge : ndarray, shape (16,), float32
        Positive, one per frequency.
    smooth : float
        Weight of the differences D of neighbouring latent rows.
    """
    n = model.latents
    differences = sparse.eye_array(n - 1, n, k=1) - sparse.eye_array(n - 1, n)
    gradient = smooth * (differences.T @ differences)
    half = BLOCK * int((np.arange(len(model.coupled)) - model.coupled).max() + 1)
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        adjoint = blur.conj().T
        normal = adjoint @ blur + gradient
        band: Any = np.zeros((min(half, n), n), dtype=np.complex128)
        for offset, row in enumerate(band):
            row[: n - offset] = normal.diagonal(-offset)
        band[0] += ridge[lane]
        right: Any = adjoint @ _load(data, lane) + _load(latent, lane)
        _store(latent, lane, solveh_banded(band, right, lower=True))


def _matrices(model: RowModel, table: Real, rows: int) -> list[sparse.csr_array]:
    """Return A for each lane, shape (H, L)."""
    seen = np.repeat(model.row_end - model.row_first, BLOCK)
    first = np.repeat(model.row_first, BLOCK)
    latent = np.repeat(np.arange(model.latents), seen)
    row = np.arange(len(latent)) - np.repeat(np.cumsum(seen) - seen, seen) + np.repeat(first, seen)
    taps = np.diff(model.tap_start)
    at = np.repeat(row, taps), np.repeat(latent, taps)
    phases = table[model.tap_shift, 0] + 1j * table[model.tap_shift, 1].astype(np.complex128)
    values = model.tap_weight[:, None] * phases
    return [sparse.csr_array((values[:, lane], at), shape=(rows, model.latents)) for lane in range(LANES)]


def _load(lanes: Real, lane: int) -> NDArray[np.complex128]:
    """(R, C) of one lane."""
    return (lanes[:, :, 0, lane] + 1j * lanes[:, :, 1, lane].astype(np.complex128)).T


def _store(lanes: Real, lane: int, values: Any) -> None:
    lanes[:, :, 0, lane], lanes[:, :, 1, lane] = values.T.real, values.T.imag


def _unpacked(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Let a kernel of the C extension take a model in place of its arrays."""
    return lambda model, *arguments: kernel(*model, *arguments)


workspace_size: Callable[[RowModel, Real, int, bool], int]
workspace_size = _unpacked(native.rowwise_workspace) if native else workspace_size_numpy
forward: Callable[..., None] = _unpacked(native.rowwise_forward) if native else forward_numpy
adjoint: Callable[..., None] = _unpacked(native.rowwise_adjoint) if native else adjoint_numpy
solve: Callable[..., None] = _unpacked(native.rowwise_solve) if native else solve_numpy
