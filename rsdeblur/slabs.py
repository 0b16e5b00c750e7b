"""Large pictures in bounded memory: slabs of rows that are solved one after the other.

A slab reads more rows than it gives, so that what happens at its own ends does not reach the rows that it gives. Its
PSFs are those of the whole picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.method import Method
from rsdeblur.psf import PsfBank

# Rows read beyond those given, in heights of the PSF K: the filter's response decays over K / (2 pi sqrt(nsr)), and
# this is four times that; a prior on the gradient is as wide as its tiles' gap.
DECAY_REACH, LEAST_REACH = 0.64, 2.5
PRIOR_REACH = 5.0
# Pictures of a slab's size that are held at a time (light, result, spectra or lanes, latents), by mode and prior.
TILE_PICTURES, TILE_PRIOR_PICTURES = 3.3, 7.0
ROW_PICTURES, ROW_PRIOR_PICTURES = 4.6, 8.0
# Bytes of the rowwise model for every row, strip and px of the kernel: paths, taps and workspaces.
ROW_MODEL = 400.0
# What does not grow with the slab: buffers of threads, libraries' own.
FIXED = 48 << 20
LEAST_ROWS = 16


@dataclass(frozen=True, slots=True)
class Slab:
    """Rows `read` of the picture are solved with PSFs `bank`, placed in them, and rows `given` are kept."""

    read: slice
    given: slice
    bank: PsfBank


def plan_slabs(
    bank: PsfBank, shape: tuple[int, int, int], method: Method, max_memory: int | None
) -> tuple[list[Slab], int]:
    """Cut a picture into the fewest slabs that need at most `max_memory` bytes, and return them with what they need.

    Raises
    ------
    InputError
        If the narrowest slab needs more.
    """
    height = shape[0]
    whole = Slab(slice(0, height), slice(0, height), bank)
    if max_memory is None:
        return [whole], _bytes(whole, shape, method)
    reach = _reach(bank.size[0], method)
    count, most = 1, -(-height // LEAST_ROWS)
    while True:
        edges = [height * i // count for i in range(count + 1)]
        slabs = [_slab(bank, height, a, b, reach) for a, b in pairwise(edges)]
        needed = max(_bytes(slab, shape, method) for slab in slabs)
        if needed <= max_memory:
            return slabs, needed
        if count == most:
            raise InputError(
                f"max_memory is {_mebibytes(max_memory)}, but even {LEAST_ROWS} rows of this picture need "
                f"{_mebibytes(needed)} with PSFs of {bank.size[1]}x{bank.size[0]} px; fewer strips or bands need less"
            )
        count = min(most, count + 1 + count // 8)


def _slab(bank: PsfBank, height: int, first: int, stop: int, reach: int) -> Slab:
    read = slice(max(first - reach, 0), min(stop + reach, height))
    # From the last PSF above the rows given to the first one below.
    above = max(int(np.searchsorted(bank.rows, first, side="right")) - 1, 0)
    below = min(int(np.searchsorted(bank.rows, stop - 1)), len(bank.rows) - 1)
    part = slice(above, below + 1)
    return Slab(read, slice(first, stop), PsfBank(bank.kernels[part], bank.rows[part] - read.start, bank.cols))


def _reach(kernel: int, method: Method) -> int:
    wanted = max(LEAST_REACH, DECAY_REACH / method.nsr**0.5) if method.weight is None else PRIOR_REACH
    return int(np.ceil(wanted * kernel))


def _bytes(slab: Slab, shape: tuple[int, int, int], method: Method) -> int:
    """Predict what solving a slab takes."""
    rows, (_, width, channels) = slab.read.stop - slab.read.start, shape
    bands, strips = slab.bank.kernels.shape[:2]
    tall, wide = slab.bank.size
    picture = 4.0 * rows * width * channels
    if method.mode == "rowwise":
        pictures = ROW_PICTURES if method.weight is None else ROW_PRIOR_PICTURES
        return int(FIXED + pictures * picture + ROW_MODEL * rows * strips * (tall + wide))
    pictures = TILE_PICTURES if method.weight is None else TILE_PRIOR_PICTURES
    pitch = rows / bands
    length = rows + tall if bands == 1 else min(rows + tall, 2.2 * (2 * pitch + _reach(tall, method) / 2))
    row = width + wide if strips == 1 else min(width + wide, 2 * width / strips + 4 * wide)
    # A complex value for every second frequency along x; with a prior twice.
    filters = 4.0 * bands * strips * length * row * (1 if method.weight is None else 2)
    return int(FIXED + pictures * picture + filters + 8.0 * length * row)


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.0f} MiB"
