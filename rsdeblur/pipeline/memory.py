"""Large pictures in bounded memory: slabs of rows that are solved one after the other.

A slab reads more rows than it gives, so that what happens at its own ends does not reach the rows that it gives. Its
PSFs are those of the whole picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from rsdeblur.deconv.quadratic import MARGIN
from rsdeblur.deconv.wiener import DECAY_MARGIN, LEAST_MARGIN
from rsdeblur.errors import InputError
from rsdeblur.pipeline.settings import SolverSettings
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# Rows read beyond those given, in heights of the PSF K. The filter's response decays over K / (2 pi sqrt(nsr)): a whole
# column, or the exact solve, is cut where four times that is left; tiles see no further than their gap anyway.
DECAY_REACH, LEAST_REACH = 0.64, 2.5
MORE_THAN_MARGIN = 0.5
PRIOR_REACH = 5.0
# Pictures of a slab's size that are held at a time (light, result, spectra or lanes, latents), by mode and prior.
TILE_PICTURES, TILE_PRIOR_PICTURES = 3.3, 7.0
ROW_PICTURES, ROW_PRIOR_PICTURES = 4.6, 8.0
# Bytes of the rowwise model for every row, strip and px of the kernel: paths, taps and workspaces.
ROW_MODEL = 80.0
# What does not grow with the slab: buffers of threads, libraries' own.
FIXED = 48 << 20
LEAST_ROWS = 16
# Transforms may be longer than needed.
TRANSFORM_EXCESS = 1.1


@dataclass(frozen=True, slots=True)
class Chunk:
    """Rows `read` of the picture are solved with PSFs `bank`, placed in them, and rows `given` are kept."""

    read: slice
    given: slice
    bank: PsfBank


def plan_chunks(
    bank: PsfBank, shape: tuple[int, int, int], method: SolverSettings, max_memory: int | None
) -> tuple[list[Chunk], int]:
    """Cut a picture into the fewest slabs that need at most `max_memory` bytes, and return them with what they need.

    Raises
    ------
    InputError
        If the narrowest slab needs more.
    """
    height = shape[0]
    whole = Chunk(slice(0, height), slice(0, height), bank)
    if max_memory is None:
        return [whole], _bytes(whole, shape, method)
    reach = _reach(bank, method)
    count, most = 1, -(-height // LEAST_ROWS)
    while True:
        edges = [height * i // count for i in range(count + 1)]
        chunks = [_chunk(bank, shape, a, b, reach) for a, b in pairwise(edges)]
        needed = max(_bytes(chunk, shape, method) for chunk in chunks)
        if needed <= max_memory:
            return chunks, needed
        if count == most:
            raise InputError(
                f"max_memory is {_mebibytes(max_memory)}, but even {LEAST_ROWS} rows of this picture need "
                f"{_mebibytes(needed)} with PSFs of {bank.size[1]}x{bank.size[0]} px; fewer strips or bands need less"
            )
        count = min(most, count + 1 + count // 8)


def _chunk(bank: PsfBank, shape: tuple[int, int, int], first: int, stop: int, reach: int) -> Chunk:
    height, width, _ = shape
    read = slice(max(first - reach, 0), min(stop + reach, height))
    part = bank.cut(slice(first, stop), slice(0, width))
    return Chunk(read, slice(first, stop), replace(part, rows=part.rows - read.start))


def _margin(method: SolverSettings) -> float:
    """Return what tiles are longer than their parts, in PSFs."""
    return max(LEAST_MARGIN, DECAY_MARGIN / method.nsr**0.5) if method.weight is None else MARGIN


def _reach(bank: PsfBank, method: SolverSettings) -> int:
    if method.weight is not None:
        wanted = PRIOR_REACH
    elif method.mode == "banded" and len(bank.rows) > 1:
        wanted = _margin(method) + MORE_THAN_MARGIN
    else:
        wanted = max(LEAST_REACH, DECAY_REACH / method.nsr**0.5)
    return int(np.ceil(wanted * bank.size[0]))


def _bytes(chunk: Chunk, shape: tuple[int, int, int], method: SolverSettings) -> int:
    """Predict what solving a slab takes."""
    rows, (_, width, channels) = chunk.read.stop - chunk.read.start, shape
    bands, strips = chunk.bank.kernels.shape[:2]
    tall, wide = chunk.bank.size
    picture = 4.0 * rows * width * channels
    if method.mode == "rowwise":
        pictures = ROW_PICTURES if method.weight is None else ROW_PRIOR_PICTURES
        return int(FIXED + pictures * picture + ROW_MODEL * rows * strips * (tall + wide))
    pictures = TILE_PICTURES if method.weight is None else TILE_PRIOR_PICTURES
    length, row = (
        _tile_length(centres, n, kernel, _margin(method))
        for centres, n, kernel in ((chunk.bank.rows, rows, tall), (chunk.bank.cols, width, wide))
    )
    # A complex value for every second frequency along x; with a prior the transfer functions too.
    filters = 4.0 * bands * strips * length * row * (1 if method.weight is None else 2)
    return int(FIXED + pictures * picture + filters + 8.0 * length * row)


def _tile_length(centres: FloatArray, n: int, kernel: int, margin: float) -> float:
    """Predict the transform length of tiles along an axis of n px."""
    ends = np.concatenate([[0.0], centres, [n]])
    return TRANSFORM_EXCESS * min(float((ends[2:] - ends[:-2]).max()) + margin * kernel, n + kernel)


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.0f} MiB"
