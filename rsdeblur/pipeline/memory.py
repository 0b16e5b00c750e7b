"""Large pictures in bounded memory: chunks of rows are solved one after the other.

A chunk reads more rows than it writes, so that errors at its ends do not reach the rows that it writes. Its PSFs are
those of the whole picture.
"""

from itertools import pairwise

import numpy as np

from rsdeblur.deconv.chroma import halved
from rsdeblur.deconv.rowwise import ASSEMBLED_BYTES, MOST_MARGIN
from rsdeblur.deconv.wiener import LEAST_MARGIN, LEAST_NSR, decay_margin
from rsdeblur.errors import InputError
from rsdeblur.kernels.rowwise import BLOCK
from rsdeblur.pipeline.solver import Chunk, PictureSolver, Strengths, chroma_of
from rsdeblur.psf import affecting
from rsdeblur.types import FloatArray

# Rows read beyond those written, in heights K of the PSF. The Wiener filter's response decays over K / (2 pi
# sqrt(nsr)), and the modes "global" and "rowwise" read four times that; with a prior it decays within PRIOR_REACH.
# Tiles read no further than their part, two distances between centres, and their margin. The steps of a prior spread
# what they leave by STEP_ROWS, px, at half the size as many of these. (docs/developer/decisions.md)
DECAY_REACH, LEAST_REACH = 0.64, 2.5
PRIOR_REACH, STEP_ROWS = 4.0, 32
# Bytes that do not grow with the chunk: buffers of threads and of libraries.
FIXED = 48 << 20
LEAST_ROWS = 16


def plan_chunks(solver: PictureSolver, shape: tuple[int, int, int], max_memory: int | None) -> list[Chunk]:
    """Return the fewest chunks of a picture that need at most `max_memory` bytes each.

    If even the smallest chunks need more, raise `InputError`.
    """
    (height, width, _), bank, options = shape, solver.bank, solver.options
    if max_memory is None:
        whole = slice(0, height)
        return [Chunk(whole, whole, bank)]
    count, most = 1, -(-height // LEAST_ROWS)
    while True:
        parts = _parts(solver, height, count)
        needed = max(_bytes(solver, source, shape) for source, _ in parts)
        if needed <= max_memory:
            # Merged in a chunk, tiles of the colours would lie elsewhere than in the next one.
            is_halved = options.mode_in_effect != "rowwise" and chroma_of(options, bank.size, shape) == "half"
            half = halved(bank, threads=options.threads) if is_halved else None
            all_cols = slice(0, width)
            rows = [slice(source.start // 2, -(-source.stop // 2)) for source, _ in parts]
            return [
                Chunk(source, target, bank.cut(source, all_cols), half and half.cut(own, all_cols))
                for (source, target), own in zip(parts, rows, strict=True)
            ]
        if count == most:
            raise InputError(
                f"max_memory is {max_memory / 2**20:.0f} MiB, but even {LEAST_ROWS} rows of "
                f"{'this picture' if solver.count == 1 else f'{solver.count} frames'} need {needed / 2**20:.0f} MiB "
                f"with PSFs of {bank.size[1]}x{bank.size[0]} px; fewer strips or bands need less"
            )
        count = min(most, count + 1 + count // 8)


def least_memory(solver: PictureSolver, shape: tuple[int, int, int]) -> int:
    """Return the bytes that the smallest chunks of a picture need."""
    parts = _parts(solver, shape[0], -(-shape[0] // LEAST_ROWS))
    return max(_bytes(solver, source, shape) for source, _ in parts)


def _parts(solver: PictureSolver, height: int, count: int) -> list[tuple[slice, slice]]:
    """Return the rows that a number of equally tall chunks read, and those that they write."""
    reach = _reach(solver)
    edges = [height * i // count for i in range(count + 1)]
    # From an even row on, the pixels of half the size are those of the whole picture.
    return [(slice(max(a - reach, 0) // 2 * 2, min(b + reach, height)), slice(a, b)) for a, b in pairwise(edges)]


def _margin(strengths: Strengths) -> float:
    """Return the margin of the tiles, in PSF sizes."""
    return decay_margin(strengths.nsr) if strengths.weight is None else LEAST_MARGIN


def _reach(solver: PictureSolver) -> int:
    """Return the rows that a chunk reads beyond those that it writes."""
    bank, options, strengths = solver.bank, solver.options, solver.strengths
    tall, is_linear = bank.size[0], strengths.weight is None
    decay = max(LEAST_REACH, DECAY_REACH / max(strengths.nsr, LEAST_NSR) ** 0.5) if is_linear else PRIOR_REACH
    reach = decay * tall
    if options.mode_in_effect == "banded" and len(bank.rows) > 1:
        reach = min(reach, 2 * float(np.diff(bank.rows).max()) + _margin(strengths) * tall)
    if not is_linear:
        reach += STEP_ROWS * (2 if options.chroma_in_effect == "half" else 1)
    return int(np.ceil(reach))


def _bytes(solver: PictureSolver, source: slice, shape: tuple[int, int, int]) -> int:
    """Predict the bytes that solving the rows `source` of one or several frames takes."""
    bank, options, strengths, frames = solver.bank, solver.options, solver.strengths, solver.count
    rows, (_, width, channels) = source.stop - source.start, shape
    centres = bank.rows[affecting(bank.rows, source)] - source.start
    bands, strips, (tall, wide) = len(centres), len(bank.cols), bank.size
    picture = 4.0 * rows * width * channels
    # `pictures` are the arrays of a chunk's size in memory at a time: light, result, spectra and latents.
    if options.mode_in_effect == "rowwise":
        pictures = 4.6 if strengths.weight is None else 8.0
        pictures += 2.5 * (frames - 1)  # the rows of all frames are kept, and their spectra
        kept = 0.0
        if frames > 1 and strengths.weight is not None:
            # The assembled normal matrices: one complex value for every second frequency along x.
            row = _tile_length(bank.cols, width, wide, min(decay_margin(strengths.nsr), MOST_MARGIN))
            kept = min(4.0 * rows * (tall + BLOCK) * row, ASSEMBLED_BYTES)
        # Paths, taps and workspaces take 80 bytes for each row, strip and px of the kernel, and 0.6 times that for each
        # further frame.
        model = 80.0 * (1 + 0.6 * (frames - 1)) * rows * strips * (tall + wide)
        return int(FIXED + pictures * picture + model + kept)
    pictures = 3.3 if strengths.weight is None else 5.0
    length, row = (
        _tile_length(places, n, kernel, _margin(strengths))
        for places, n, kernel in ((centres, rows, tall), (bank.cols, width, wide))
    )
    # One complex value for every second frequency along x: a filter of each tile. With a prior or several frames, the
    # sums of the normal equations instead, and the OTFs of one strip.
    tiles = float(bands * strips * length * row)
    filters = 4.0 * tiles
    if frames > 1 or strengths.weight is not None:
        # Those of brightness and of colours at half size are not kept at the same time.
        together = 1 if chroma_of(options, bank.size, shape) == "half" else channels
        filters = (4.0 * together + 2.0) * tiles + 4.0 * tiles / strips
    if frames > 1:
        pictures += 4.0  # the next frame, the solution of the first one and its blur
        filters += 4.0 * tiles  # the prediction of what a frame does not show has OTFs of its own
    return int(FIXED + pictures * picture + filters + 8.0 * length * row)


def _tile_length(centres: FloatArray, n: int, kernel: int, margin: float) -> float:
    """Predict the transform length of tiles along an axis of n px."""
    ends = np.concatenate([[0.0], centres, [n]])
    # Transforms are up to a tenth longer than needed, because only some lengths are fast.
    return 1.1 * min(float((ends[2:] - ends[:-2]).max()) + margin * kernel, n + kernel)
