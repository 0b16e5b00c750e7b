"""The rowwise solve by conjugate gradients, for PSFs so tall that a factorisation takes too much time or memory.

The preconditioner is the banded Wiener filter, made symmetric. Within a slab of rows the PSF of the middle row is used
for all rows, which makes the normal matrix diagonal in the slab's Fourier domain. Slabs overlap; the square roots of
their blending weights are applied before and after.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import fft

from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.kernels import rowwise
from rsdeblur.kernels.rowwise import LANES, RowModel
from rsdeblur.psf import tile_centres
from rsdeblur.types import Float32Array

# Norm of the residual as a share of that of the right-hand side. The error against the direct solve is then 60 dB below
# the picture, after some 9 steps for PSFs of any height (docs/developer/decisions.md).
TOLERANCE = 1e-3
# Distance between slabs in heights of the tallest PSF. A smaller one hardly saves steps.
SLAB_PITCH = 2.0


class NormalEquations:
    """`A^H A + p0 + p1 D^T D + p2 (D^T D)^2` for one block of frequencies, and an approximate inverse.

    D takes differences along y, and p is `penalty`. Vectors are latent spectra of one block, shape (C, L, 2, 16); the
    axis of 2 is real and imaginary part. The rows of A are those of one picture, or row by row those of several
    `frames`.
    """

    def __init__(
        self,
        model: RowModel,
        table: Float32Array,
        rows: int,
        penalty: Float32Array,
        workspace: Float32Array,
        frames: int = 1,
    ) -> None:
        self._model, self._table, self._workspace, self._frames = model, table, workspace, frames
        self._rows, self._penalty = rows, penalty
        self._plan()

    def multiply(self, vector: Float32Array) -> Float32Array:
        """Return the matrix times `vector`."""
        blurred = np.empty((len(vector), self._rows, 2, LANES), dtype=np.float32)
        result = np.empty_like(vector)
        rowwise.forward(self._model, self._table, blurred, vector, self._workspace)
        rowwise.adjoint(self._model, self._table, blurred, result, self._workspace)
        ridge, slope, bend = self._penalty
        result += ridge * vector
        if self._penalty[1:].any():
            result += _bent(slope * vector + bend * _bent(vector))
        return result

    def precondition(self, vector: Float32Array) -> Float32Array:
        """Return the approximate inverse times `vector`."""
        values = vector[:, :, 0] + 1j * vector[:, :, 1]
        result = np.zeros_like(values)
        for block, weights, inverse in self._blocks:
            spectrum = fft.fft(values[:, block] * weights, len(inverse), axis=1)
            spectrum *= inverse
            result[:, block] += fft.ifft(spectrum, axis=1)[:, : len(weights)] * weights
        return np.stack([result.real, result.imag], axis=2)

    def _plan(self) -> None:
        latents = self._model.latents
        tall = rowwise.BLOCK * int((np.arange(len(self._model.coupled)) - self._model.coupled).max() + 1)
        count = max(1, round(latents / (SLAB_PITCH * tall)))
        windows = np.sqrt(hat_weights(tile_centres(count, latents), latents)).astype(np.float32)
        # Some rows of A, conjugated, one per channel: the adjoint of unit vectors.
        unit = np.zeros((count, self._frames, self._rows, 2, LANES), dtype=np.float32)
        middles = np.round(tile_centres(count, self._rows // self._frames)).astype(int)
        for frame in range(self._frames):
            unit[np.arange(count), frame, self._frames * middles + frame, 0] = 1.0
        kernels = np.empty((count * self._frames, latents, 2, LANES), dtype=np.float32)
        rowwise.adjoint(self._model, self._table, unit.reshape(-1, *unit.shape[2:]), kernels, self._workspace)
        self._blocks: list[tuple[slice, Float32Array, Float32Array]] = []
        for window, parts in zip(windows, kernels.reshape(count, self._frames, *kernels.shape[1:]), strict=True):
            at = np.flatnonzero(window)
            length = fft.next_fast_len(len(at) + tall)
            power = np.zeros((length, LANES), dtype=np.float32)
            for kernel in parts:
                # The power spectrum does not depend on where the kernel lies, as long as it is in one piece.
                seen = np.flatnonzero(kernel.any(axis=(1, 2)))
                part = kernel[seen[0] : seen[-1] + 1]
                power += np.abs(fft.fft(part[:, 0] + 1j * part[:, 1], length, axis=0)) ** 2
            squared = 2 - 2 * np.cos(2 * np.pi * np.arange(length) / length)[:, None]
            ridge, slope, bend = self._penalty
            power += ridge + squared * (slope + squared * bend)
            self._blocks.append((slice(at[0], at[-1] + 1), window[at][:, None], (1 / power).astype(np.float32)))


def _bent(vector: Float32Array) -> Float32Array:
    """Return `D^T D` times a vector; no difference crosses an end."""
    steps = np.diff(vector, axis=1, prepend=vector[:, :1], append=vector[:, -1:])
    return -np.diff(steps, axis=1)


def is_faster(model: RowModel, channels: int, frames: int = 1) -> bool:
    """Return whether conjugate gradients are predicted to take less time than a factorisation."""
    heights = rowwise.BLOCK * (np.arange(len(model.coupled)) - model.coupled + 1.0)
    # Seconds per latent row for a block of 16 frequencies, measured with AVX-512. A factorisation's grow with the
    # squared height of its coupling. Each of nine steps has some for a channel, and some for each row of that height.
    factor = 1e-9 * np.square(heights).mean()
    return bool(9 * channels * (8e-7 + 6e-9 * frames * heights.mean()) < factor)


def conjugate_gradients(
    multiply: Callable[[Float32Array], Float32Array],
    precondition: Callable[[Float32Array], Float32Array],
    right: Float32Array,
) -> Float32Array:
    """Return the solution for the right-hand side `right` (C, L, 2, 16).

    Every channel and frequency is a system of its own; all take the same number of steps.
    """
    solution, rest = np.zeros_like(right), right.copy()
    enough = TOLERANCE**2 * _dot(right, right)
    direction = correction = precondition(rest)
    gain = _dot(rest, correction)
    for _ in range(60):
        image = multiply(direction)
        step = _ratio(gain, _dot(direction, image))
        solution += step * direction
        rest -= step * image
        if (_dot(rest, rest) <= enough).all():
            break
        correction = precondition(rest)
        before, gain = gain, _dot(rest, correction)
        direction = correction + _ratio(gain, before) * direction
    return solution


def _dot(a: Float32Array, b: Float32Array) -> Float32Array:
    """Return the real part of the inner product along y, shape (C, 1, 1, 16)."""
    product: Float32Array = np.einsum("cyzl,cyzl->cl", a, b)[:, None, None]
    return product


def _ratio(a: Float32Array, b: Float32Array) -> Float32Array:
    """Return `a / b`, and 0 where `b` is 0."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
