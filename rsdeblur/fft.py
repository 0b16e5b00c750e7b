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


# Time that FFTW takes per point for each prime factor of a length, relative to a factor of 2; fitted to measured plans
# of lengths 1550 to 2310 (real and complex, float32, AVX-512), which it predicts within 20 %.
FACTOR_COST = {2: 1.0, 3: 2.4, 5: 2.5, 7: 4.8, 11: 9.0, 13: 10.0}
# A length may exceed what is needed by this share, so that two axes stay within 8 % more pixels.
EXCESS = 0.038


def fast_length(minimum: int) -> int:
    """Return the even length of at least `minimum` that FFTW transforms fastest, at most 3.8 % (or 2) longer."""
    lengths = range(minimum + minimum % 2, max(int(minimum * (1 + EXCESS)), minimum + 2) + 1, 2)
    return min(lengths, key=_cost)


def _cost(length: int) -> float:
    """Predicted time of a transform; an unknown prime costs like a multiple of the largest known one."""
    rest, per_point = length, 0.0
    for factor, cost in FACTOR_COST.items():
        while rest % factor == 0:
            rest //= factor
            per_point += cost
    return length * (per_point + (rest if rest > 1 else 0))


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
