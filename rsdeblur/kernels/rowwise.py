"""The blur of every row, its adjoint and the direct solve, for 16 frequencies at once: the C kernels and their twins.

A spectrum is stored as *lanes*, shape (B, C, R, 2, 16) float32: the real and imaginary part of frequency 16 b + i, for
channel c and row r, are at [b, c, r, :, i]. A kernel works on one block b of 16 frequencies; blocks differ in their
table of phases only.

The assembled normal matrix A^H A of a block of frequencies is an array of records (2, 16): for each block J of latent
rows, and each block I from `coupled[J]` to J, the conjugates of the nine values at the rows of J (outer) and the
columns of I.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import solveh_banded

from rsdeblur.kernels import native, unpacked
from rsdeblur.types import Float32Array, Int32Array

# Frequencies per block: the widest SIMD vector has 16 floats, and so does a cache line.
LANES = 16
# Latent rows that the kernels process together.
BLOCK = 3


class RowModel(NamedTuple):
    """The blur of every row as taps: `A[y, j] = sum of weight * phase(shift)` for picture row y and latent row j.

    Block J consists of the latent rows 3 J to 3 J + 2.
    """

    # The picture rows `row_first[J]` to `row_end[J] - 1` see block J.
    row_first: Int32Array
    row_end: Int32Array
    # First block that shares a picture row, or a gradient, with block J.
    coupled: Int32Array
    # Index of the first tap of every pair of a latent row j and a picture row y that sees its block, j outermost; and
    # the number of taps.
    tap_start: Int32Array
    # Index into the table of phases, and weight, of each tap.
    tap_shift: Int32Array
    tap_weight: Float32Array

    @property
    def latents(self) -> int:
        """Number of latent rows."""
        return BLOCK * len(self.row_first)


def phase_table(block: int, first_shift: int, shifts: int, length: int) -> Float32Array:
    """Return `exp(-2 pi i k s / length)` for k = 16 block to 16 block + 15 and each shift s; shape (shifts, 2, 16)."""
    k, s = LANES * block + np.arange(LANES), first_shift + np.arange(shifts)
    # Whole turns do not change the phase; without them the argument is small and its sine precise.
    phases = np.exp(-2j * np.pi / length * (np.outer(s, k) % length))
    return np.stack([phases.real, phases.imag], axis=1).astype(np.float32)


def workspace_size_numpy(model: RowModel, table: Float32Array, rows: int, solve: bool) -> int:
    """Return the number of floats of workspace that a kernel needs; the twins need none."""
    return 0


def forward_numpy(
    model: RowModel, table: Float32Array, data: Float32Array, latent: Float32Array, workspace: Float32Array
) -> None:
    """Compute the blur `data = A latent` of one block of frequencies.

    `data` (C, H, 2, 16) and `latent` (C, L, 2, 16) are lanes, `table` the phases of the block (:func:`phase_table`),
    and `workspace` has at least :func:`workspace_size` values.
    """
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        _store(data, lane, blur @ _load(latent, lane))


def adjoint_numpy(
    model: RowModel, table: Float32Array, data: Float32Array, latent: Float32Array, workspace: Float32Array
) -> None:
    """Compute the adjoint `latent = A^H data`; parameters are those of :func:`forward_numpy`."""
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        _store(latent, lane, blur.conj().T @ _load(data, lane))


def solve_numpy(
    model: RowModel,
    table: Float32Array,
    data: Float32Array,
    latent: Float32Array,
    workspace: Float32Array,
    penalty: Float32Array,
) -> None:
    """Solve `(A^H A + p0 + p1 D^T D + p2 (D^T D)^2) u = A^H data + latent`, p being `penalty`; u replaces `latent`.

    `penalty` (3, 16) has values for each frequency, the first ones positive, the others at least 0. D takes the
    differences of neighbouring latent rows. Other parameters are those of :func:`forward_numpy`.
    """
    n = model.latents
    differences = sparse.eye_array(n - 1, n, k=1) - sparse.eye_array(n - 1, n)
    once = differences.T @ differences
    twice = once @ once
    below = min(n, BLOCK * int((np.arange(len(model.coupled)) - model.coupled).max() + 1))
    for lane, blur in enumerate(_matrices(model, table, data.shape[1])):
        ridge, slope, bend = penalty[:, lane].astype(np.float64)
        normal = blur.conj().T @ blur + ridge * sparse.eye_array(n) + slope * once + bend * twice
        band = np.zeros((below, n), dtype=np.complex128)
        for offset in range(below):
            band[offset, : n - offset] = normal.diagonal(-offset)
        right: Any = blur.conj().T @ _load(data, lane) + _load(latent, lane)
        try:
            right = solveh_banded(band, right, lower=True, check_finite=False)
        except np.linalg.LinAlgError:  # no solution: not positive definite, or not finite
            right = np.full_like(right, np.nan)
        _store(latent, lane, right)


def _matrices(model: RowModel, table: Float32Array, rows: int) -> list[sparse.csr_array]:
    """Return the matrix A of each lane, shape (H, L)."""
    counts, first = (np.repeat(each, BLOCK) for each in (model.row_end - model.row_first, model.row_first))
    latent = np.repeat(np.arange(model.latents), counts)
    row = np.arange(len(latent)) + np.repeat(first + counts - np.cumsum(counts), counts)
    taps = np.diff(model.tap_start)
    at = np.repeat(row, taps), np.repeat(latent, taps)
    phases = table[model.tap_shift, 0] + 1j * table[model.tap_shift, 1].astype(np.complex128)
    values = model.tap_weight[:, None] * phases
    return [sparse.csr_array((values[:, lane], at), shape=(rows, model.latents)) for lane in range(LANES)]


def _load(lanes: Float32Array, lane: int) -> NDArray[np.complex128]:
    """Return one lane, shape (R, C)."""
    return (lanes[:, :, 0, lane] + 1j * lanes[:, :, 1, lane].astype(np.complex128)).T


def _store(lanes: Float32Array, lane: int, values: Any) -> None:
    lanes[:, :, 0, lane], lanes[:, :, 1, lane] = values.T.real, values.T.imag


def _missing(*arguments: Any) -> None:
    raise NotImplementedError("the C extension alone solves in two steps")


workspace_size: Callable[[RowModel, Float32Array, int, bool], int]
workspace_size = unpacked(native.rowwise_workspace) if native else workspace_size_numpy
forward: Callable[..., None] = unpacked(native.rowwise_forward) if native else forward_numpy
adjoint: Callable[..., None] = unpacked(native.rowwise_adjoint) if native else adjoint_numpy
solve: Callable[..., None] = unpacked(native.rowwise_solve) if native else solve_numpy
# Solving in two steps, of which several solves share the first, is a matter of speed: it has no twins. `assemble` fills
# `normal`, floats of a size that `assembled_size` returns, with A^H A; `solve_assembled` takes it and a right-hand side
# in `latent`.
assembled_size: Callable[[RowModel, Float32Array, int], int]
assembled_size = unpacked(native.rowwise_assembled_size) if native else lambda *_: 1 << 62  # never kept
assemble: Callable[..., None] = unpacked(native.rowwise_assemble) if native else _missing
solve_assembled: Callable[..., None] = unpacked(native.rowwise_solve_assembled) if native else _missing
