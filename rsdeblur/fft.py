"""The only place that talks to FFTW: planned transforms of lines on buffers they own, and the thread count.

A plan runs in the thread that calls it; threads share work by blocks (`rsdeblur.hybrid`), not within a transform.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pyfftw
from numpy.typing import NDArray

from rsdeblur import _validate

Complex = NDArray[np.complex64]
Real = NDArray[np.float32]

Planning = Literal["estimate", "measure"]
PLANNINGS: tuple[Planning, ...] = ("estimate", "measure")

# Bound on the time spent measuring one plan, s.
PLANNING_TIME = 1.0


def thread_count(threads: int | None) -> int:
    """Return `threads`, or the number of processors this process may use if it is None."""
    if threads is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return _validate.count("threads", threads)


# FFTW is fast where vectors of 16 fit, and pays for every odd factor. Time per point over that of a power of two,
# fitted to measured plans of lengths 96 to 2310 (float32, AVX-512): what each factor adds, what each 3 beyond the first
# adds again, and what each factor of 2 short of 16 adds.
FACTOR_COST = {3: 0.15, 5: 0.15, 7: 0.4, 11: 1.0, 13: 1.3}
FURTHER_3_COST = 0.35
SHORT_OF_16_COST = 0.25


def fast_length(minimum: int, *, excess: float) -> int:
    """Return the even length from `minimum` up, longer by the share `excess` at most, that FFTW transforms fastest."""
    lengths = range(minimum + minimum % 2, max(int(minimum * (1 + excess)), minimum + 2) + 1, 2)
    return min(lengths, key=_cost)


def _cost(length: int) -> float:
    """Predicted time of a transform; an unknown prime costs like a direct sum over it."""
    rest, powers = length, dict.fromkeys((2, *FACTOR_COST), 0)
    for factor in powers:
        while rest % factor == 0:
            rest //= factor
            powers[factor] += 1
    odd = sum(cost * powers[factor] for factor, cost in FACTOR_COST.items())
    further = FURTHER_3_COST * max(powers[3] - 1, 0) + SHORT_OF_16_COST * max(4 - powers[2], 0)
    return length * (1.0 + odd + further + (rest - 1))


def empty(shape: tuple[int, ...], dtype: type[Any]) -> NDArray[Any]:
    """Uninitialised array aligned for SIMD."""
    buffer: NDArray[Any] = pyfftw.empty_aligned(shape, dtype=dtype)
    return buffer


class RowTransform:
    """Real transform along the last axis: `real` (..., n) <-> `spectrum` (..., n // 2 + 1), both owned here.

    The inverse is not scaled and destroys `spectrum`.
    """

    def __init__(self, shape: tuple[int, ...], planning: Planning = "estimate") -> None:
        self.real: Real = empty(shape, np.float32)
        self.spectrum: Complex = empty((*shape[:-1], shape[-1] // 2 + 1), np.complex64)
        self.forward = _plan(self.real, self.spectrum, "FFTW_FORWARD", planning)
        self.inverse = _plan(self.spectrum, self.real, "FFTW_BACKWARD", planning)
        # Blocks may be filled in part, and transforms run over all of them.
        self.real[...] = 0
        self.spectrum[...] = 0


class LineTransform:
    """Complex transform in place along the last axis of `data`, owned here. The inverse is not scaled."""

    def __init__(self, shape: tuple[int, ...], planning: Planning = "estimate") -> None:
        self.data: Complex = empty(shape, np.complex64)
        self.forward = _plan(self.data, self.data, "FFTW_FORWARD", planning)
        self.inverse = _plan(self.data, self.data, "FFTW_BACKWARD", planning)
        self.data[...] = 0


def _plan(source: NDArray[Any], target: NDArray[Any], direction: str, planning: Planning) -> Callable[[], None]:
    """Return the transform of lines from `source` to `target`, unscaled; it may destroy `source`."""
    plan = pyfftw.FFTW(
        source,
        target,
        axes=(-1,),
        direction=direction,
        flags=(f"FFTW_{planning.upper()}", "FFTW_DESTROY_INPUT"),
        planning_timelimit=PLANNING_TIME,
    )
    execute: Callable[[], None] = plan.execute
    return execute
