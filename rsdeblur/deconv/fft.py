"""The only module that calls FFTW: planned transforms of lines, in buffers that belong to the transforms.

A transform runs in the thread that calls it; threads share blocks of work (`rsdeblur.deconv.hybrid`), not transforms.

Measured plans are kept in the user's cache folder, in one file per FFTW version and processor, for all later processes
that measure. FFTW would use its memory of plans, its wisdom, for estimated ones too, so that the bits of a result would
depend on what was measured before. Hence it has the wisdom of measured plans only while it measures.
"""

from __future__ import annotations

import hashlib
import platform
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pyfftw
from numpy.typing import NDArray

from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import read_file
from rsdeblur._util.memory import empty
from rsdeblur._util.threads import held_at_forks
from rsdeblur.choices import Planning
from rsdeblur.errors import FileFormatError, OutputError, RsdeblurWarning
from rsdeblur.kernels import spectral
from rsdeblur.types import ComplexArray, Float32Array

# Bound on the time spent measuring one plan, s.
PLANNING_TIME = 1.0


# Time per point of a transform, relative to that of a power of two. FFTW is fast for multiples of 16, and each odd
# factor costs time. Fitted to measured plans of lengths 96 to 2310 (float32, AVX-512): what each factor adds, what each
# 3 after the first adds in addition, and what each factor of 2 that is missing to 16 adds.
FACTOR_COST = {3: 0.15, 5: 0.15, 7: 0.4, 11: 1.0, 13: 1.3}
FURTHER_3_COST = 0.35
SHORT_OF_16_COST = 0.25


def fast_length(minimum: int, *, excess: float) -> int:
    """Return the even length from `minimum` to about `minimum * (1 + excess)` that FFTW transforms fastest."""
    lengths = range(minimum + minimum % 2, max(int(minimum * (1 + excess)), minimum + 2) + 1, 2)
    return min(lengths, key=_cost)


def _cost(length: int) -> float:
    """Return the predicted time of a transform; a prime above 13 costs as much as a direct sum over it."""
    rest, powers = length, dict.fromkeys((2, *FACTOR_COST), 0)
    for factor in powers:
        while rest % factor == 0:
            rest //= factor
            powers[factor] += 1
    odd = sum(cost * powers[factor] for factor, cost in FACTOR_COST.items())
    further = FURTHER_3_COST * max(powers[3] - 1, 0) + SHORT_OF_16_COST * max(4 - powers[2], 0)
    return length * (1.0 + odd + further + (rest - 1))


class RowTransform:
    """Real transform along the last axis: `real` (C, R, n) <-> R rows of `spectra` (C, H, K), K > n // 2.

    Both buffers are created here, unless `spectra` are passed. The inverse is not scaled. Lines of even length are
    transformed as half as many complex values (:func:`rsdeblur.kernels.spectral.unpair_numpy`).
    """

    def __init__(
        self, shape: tuple[int, int, int], planning: Planning = "estimate", spectra: ComplexArray | None = None
    ) -> None:
        *lines, n = shape
        self.real: Float32Array = empty(shape, np.float32)
        self.spectra: ComplexArray = empty((*lines, n // 2 + 1), np.complex64) if spectra is None else spectra
        self._paired = n % 2 == 0
        self._packed: ComplexArray = empty((*lines, n // 2 if self._paired else n // 2 + 1), np.complex64)
        self._turns = spectral.turns(n // 2)
        values = self.real.view(np.complex64) if self._paired else self.real
        self._forward: Callable[[], None] = _plan(values, self._packed, "FFTW_FORWARD", planning).execute
        self._inverse: Callable[[], None] = _plan(self._packed, values, "FFTW_BACKWARD", planning).execute
        # A caller may fill the buffer in part, but the transform reads all of it.
        self.real[...] = 0

    def forward(self, top: int = 0) -> None:
        """Transform into the rows of `spectra` from `top` on; the frequencies beyond the highest become zero."""
        self._forward()
        if self._paired:
            spectral.unpair(self._packed, self._turns, self.spectra, top)
            return
        rows, frequencies = self._packed.shape[1:]
        self.spectra[:, top : top + rows, :frequencies] = self._packed
        self.spectra[:, top : top + rows, frequencies:] = 0

    def inverse(self, top: int = 0) -> None:
        """Transform the rows of `spectra` from `top` on back."""
        if self._paired:
            spectral.pair(self.spectra, top, self._turns, self._packed)
        else:
            rows, frequencies = self._packed.shape[1:]
            self._packed[...] = self.spectra[:, top : top + rows, :frequencies]
        self._inverse()


class LineTransform:
    """Complex transform along the last axis: `lines` (..., n) <-> `spectra` (..., n).

    Both buffers are created here. The inverse is not scaled. Transforms in place would take FFTW more than twice the
    time unless it measures its plans. Each direction may destroy what it reads.
    """

    def __init__(self, shape: tuple[int, ...], planning: Planning = "estimate") -> None:
        self.lines: ComplexArray = empty(shape, np.complex64)
        self.spectra: ComplexArray = empty(shape, np.complex64)
        self.forward: Callable[[], None] = _plan(self.lines, self.spectra, "FFTW_FORWARD", planning).execute
        self.inverse: Callable[[], None] = _plan(self.spectra, self.lines, "FFTW_BACKWARD", planning).execute
        self.lines[...] = 0
        self.spectra[...] = 0


def _plan(source: NDArray[Any], target: NDArray[Any], direction: str, planning: Planning) -> Any:
    """Return the transform of lines from `source` to `target`, unscaled; it may destroy `source`."""

    def plan(limit: float | None) -> Any:
        flags = (f"FFTW_{planning.upper()}", "FFTW_DESTROY_INPUT")
        return pyfftw.FFTW(source, target, axes=(-1,), direction=direction, flags=flags, planning_timelimit=limit)

    if planning == "estimate":
        with _planner:
            return plan(None)
    _recall()
    with _measured_wisdom(_measured):
        planned = plan(PLANNING_TIME)
        _measured[:] = [pyfftw.export_wisdom()[1]]
    return planned


# Wisdom about the plans that this process and earlier ones measured.
_measured: list[bytes] = []
# FFTW has one planner and one wisdom per process.
_planner = held_at_forks(threading.RLock())


@contextmanager
def _measured_wisdom(single: list[bytes]) -> Iterator[None]:
    """Give FFTW this wisdom alone, in single precision; what it knew of estimated plans is put aside meanwhile."""
    with _planner:
        aside = pyfftw.export_wisdom()
        pyfftw.forget_wisdom()
        for wisdom in single:
            pyfftw.import_wisdom((b"", wisdom, b""))
        try:
            yield
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(aside)


def wisdom_file() -> Path:
    """Return the path of the file with this machine's measured plans."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(line for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        processor = platform.processor()
    kind = hashlib.sha256(f"{platform.machine()} {processor}".encode()).hexdigest()[:12]
    return platformdirs.user_cache_path("rsdeblur") / f"{pyfftw.fftw_version}-{kind}.wisdom"


@cache
def _recall() -> None:
    """Load the plans that earlier processes measured, once per process."""
    _measured.extend(_stored())


def _stored() -> list[bytes]:
    """Return the wisdom that is stored, if there is any that is sound."""
    try:
        seal, _, single = read_file(wisdom_file(), "wisdom").partition(b"\n")
    except FileFormatError:
        return []
    # FFTW ignores wisdom of another build, but damaged wisdom may make it abort the process; hence the seal.
    return [single] if seal == _seal(single) else []


def _seal(wisdom: bytes) -> bytes:
    return hashlib.sha256(wisdom).hexdigest().encode()


def remember() -> None:
    """Store all plans measured so far, together with those that other processes stored meanwhile.

    If the cache folder cannot be written, this warns once per process, and the next process measures again.
    """
    file = wisdom_file()
    stored = _stored()
    with _measured_wisdom([*_measured, *stored]):
        single = pyfftw.export_wisdom()[1]
    # FFTW exports its plans in any order.
    if stored and sorted(stored[0].splitlines()) == sorted(single.splitlines()):
        return
    sealed = _seal(single) + b"\n" + single
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as out:
            out.write(sealed)
    except (OSError, OutputError) as error:
        _warn_not_kept(str(error))


@cache
def _warn_not_kept(reason: str) -> None:
    warnings.warn(f"measured FFT plans cannot be kept, planning is repeated next time: {reason}", RsdeblurWarning, 3)
