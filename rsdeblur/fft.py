"""The only place that talks to FFTW: planned transforms on buffers they own, and the thread count."""

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


def fast_length(minimum: int) -> int:
    """Smallest length of at least `minimum` that FFTW transforms fast: even, with prime factors up to 11."""
    return int(pyfftw.next_fast_len((minimum + 1) // 2)) * 2


class RowTransform:
    """Real transform along the last axis: `real` (..., n) <-> `spectrum` (..., n // 2 + 1), both owned here.

    The inverse is not scaled and destroys `spectrum`.
    """

    def __init__(self, shape: tuple[int, ...], threads: int, planning: Planning = "estimate") -> None:
        self.real: Real = pyfftw.empty_aligned(shape, dtype=np.float32)
        self.spectrum: Complex = pyfftw.empty_aligned((*shape[:-1], shape[-1] // 2 + 1), dtype=np.complex64)
        self.forward = _plan(self.real, self.spectrum, (-1,), "FFTW_FORWARD", threads, planning)
        self.inverse = _plan(self.spectrum, self.real, (-1,), "FFTW_BACKWARD", threads, planning)


class ColumnTransform:
    """Complex transform in place along the second last axis of `data`, owned here. The inverse is not scaled."""

    def __init__(self, shape: tuple[int, ...], threads: int, planning: Planning = "estimate") -> None:
        self.data: Complex = pyfftw.empty_aligned(shape, dtype=np.complex64)
        self.forward = _plan(self.data, self.data, (-2,), "FFTW_FORWARD", threads, planning)
        self.inverse = _plan(self.data, self.data, (-2,), "FFTW_BACKWARD", threads, planning)


def _plan(
    source: NDArray[Any], target: NDArray[Any], axes: tuple[int, ...], direction: str, threads: int, planning: Planning
) -> Callable[[], None]:
    """Return the transform from `source` to `target`, unscaled; it may destroy `source`."""
    plan = pyfftw.FFTW(
        source,
        target,
        axes=axes,
        direction=direction,
        flags=(f"FFTW_{planning.upper()}", "FFTW_DESTROY_INPUT"),
        threads=threads,
        planning_timelimit=PLANNING_TIME,
    )
    execute: Callable[[], None] = plan.execute
    return execute
