"""Aligned frames of a burst, solved together chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.burst.alignment import AlignedBurst, combined
from rsdeblur.burst.frames import BurstFrame
from rsdeblur.choices import EXPONENT
from rsdeblur.deconv.burst import BurstQuadratic, RowBurst
from rsdeblur.deconv.chroma import Solve
from rsdeblur.deconv.priors import brightness
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.image.mending import UndershootMeter
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.pipeline.memory import LONGEST, least_memory
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.solver import Chunk, PictureSolver, Strengths
from rsdeblur.pipeline.steps import StageClock, solve_chunks, tuned_strengths
from rsdeblur.pipeline.tiles import tile_errors, tile_paths
from rsdeblur.psf import PsfBank, size_of, tile_centres
from rsdeblur.tuning.strength import KERNELS, BlurSpectra
from rsdeblur.types import FloatArray, FloatImage, StageProgress

# Mean weight over a whole frame from which on it shows the same scene everywhere.
ALIKE = 0.99
# Bytes that the solve may use by default. The default grows to this multiple of what the smallest chunks need.
MEMORY, ABOVE_LEAST = 1 << 30, {"global": 1.1, "banded": 1.1, "rowwise": 1.25}

Part = tuple[slice, slice]


@dataclass(frozen=True, slots=True, eq=False)
class BurstSolution:
    """Everything that a burst is solved with; the reference comes first.

    `bank` are its PSFs, as large as those of any frame. Those of the others are drawn chunk by chunk, from their paths.
    """

    frames: tuple[BurstFrame, ...]
    paths: tuple[BlurPaths, ...]
    bank: PsfBank
    shares: tuple[float, ...]
    together: PictureSolver
    alone: PictureSolver

    @classmethod
    def of(cls, burst: AlignedBurst, options: Options) -> BurstSolution:
        """Derive the shares and strengths of the frames that contribute, and their PSFs."""
        frames = tuple(burst.frames[n] for n in burst.used)
        mode = options.mode_in_effect
        height, width, _ = burst.reference.encoded.shape
        centres = (tile_centres(min(KERNELS, n), n) for n in (height, width))
        some = _paths(frames, *centres, threads=options.threads)
        few = [PsfBank.from_paths(paths).padded(_largest(some)) for paths in some]
        spectra = [BlurSpectra.of(bank, one_filter=options.has_one_psf) for bank in few]
        tunings = [replace(frame.tuning, spectra=of) for frame, of in zip(frames, spectra, strict=True)]
        in_tiles = mode == "banded" and not options.has_one_psf
        errors = [sum(tile_errors(frame.alignment.capture)) if in_tiles else 0.0 for frame in frames]
        tuning, shares = combined(tunings, tile_errors=errors)
        peak = brightness(burst.reference.split.remainder(slice(None), 4))
        strengths = tuned_strengths(tuning, options, peak)
        # Where other frames do not show the scene, they repeat the result of the reference alone. For narrow margins, a
        # Wiener filter is good enough; for things that move, it costs up to 0.6 dB (tv, eight simulated bursts).
        alike = len(frames) > 1 and all(frame.fit is None or frame.fit.weights.mean() > ALIKE for frame in frames)
        simple = replace(options, prior="wiener", nsr="auto", weight="auto", exponent=EXPONENT) if alike else options
        alone = tuned_strengths(tunings[0], simple, peak)
        own = share_map(
            lambda frame: tile_paths(frame.alignment.capture, mode, options.bands, options.strips, strengths.tile_nsr),
            *(frames, options.threads),
        )
        bands, strips = (max(len(getattr(paths, axis)) for paths in own) for axis in ("rows", "cols"))
        paths = _paths(frames, tile_centres(bands, height), tile_centres(strips, width), threads=options.threads)
        # Chunks reach as far as the largest PSF of any frame.
        bank = PsfBank.from_paths(paths[0], threads=options.threads).padded(_largest(paths))
        capture = burst.reference.alignment.capture
        together, single = (
            PictureSolver(replace(each, chroma="full"), strength, bank, capture)
            for each, strength in ((options, strengths), (simple, alone))
        )
        solution = cls(frames, tuple(paths), bank, shares, together, single)
        whole = options.geometry == "rectify" or options.normalize
        memory = None if whole else solution._memory(options.max_memory)
        return replace(solution, together=replace(together, options=replace(together.options, max_memory=memory)))

    @property
    def options(self) -> Options:
        """All options."""
        return self.together.options

    @property
    def strengths(self) -> Strengths:
        """The strengths of all frames together."""
        return self.together.strengths

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.frames)

    def run(self, out: NDArray[Any], clock: StageClock) -> tuple[NDArray[np.bool_], UndershootMeter]:
        """Solve chunk by chunk into `out`, which is upright; return a mask of the pixels that were exposed."""
        reference = self.frames[0]
        meter = UndershootMeter(reference.encoded.shape[0])
        coverage = solve_chunks(reference.split, out, self, clock, meter=meter, capture=reference.alignment.capture)
        return coverage, meter

    def plan(self, chunk: Chunk, shape: tuple[int, int, int]) -> Solve:
        """Plan the solver of a chunk, see :class:`rsdeblur.pipeline.solver.ChunkSolver`."""
        del shape  # that of the light
        return partial(self._solve, chunk)

    def _memory(self, most: int | None) -> int:
        """Return the bytes that a chunk may take, with the highlights of the reference."""
        if most is not None:
            return most - sum(frame.split.nbytes for frame in self.frames[1:])
        # The default bound grows to a multiple of the least rather than refuse the burst or cut it into thin chunks.
        least = least_memory(self, self.frames[0].encoded.shape)
        return max(MEMORY, int(ABOVE_LEAST[self.options.mode_in_effect] * least))

    def _solve(self, chunk: Chunk, light: FloatImage, progress: StageProgress) -> FloatImage:
        """Return the sharp light of a chunk of rows; `light` is that of the reference, which is solved alone first."""
        alone = self.alone.plan(chunk, light.shape)
        single = alone(light, lambda share: progress(share / 3))
        if len(self.frames) == 1:
            return single
        # Free its memory before the next solver is planned.
        del alone
        solver = self._plan_solver(chunk, light.shape)
        return solver.apply(
            self._lights(chunk, light, single),
            prior=self.together.latent_prior,
            progress=lambda share: progress((1 + 2 * share) / 3),
        )

    def _lights(self, chunk: Chunk, light: FloatImage, single: FloatImage) -> Iterator[FloatImage]:
        """Yield the light of all frames at the rows of a chunk of the reference, that of the reference first.

        Where another frame does not show the scene of the reference, its pixels are replaced by those that the solution
        of the reference alone, `single`, predicts. So they neither help nor harm, and priors see whole pictures.
        """
        yield light
        threads = self.options.threads
        for n, frame in enumerate(self.frames[1:], 1):
            shown, weights = frame.light(chunk.source, threads)
            for part, blurred in predicted(single, weights < 1, self._drawn(n, chunk), threads):
                # predicted + weights (shown - predicted)
                mixed = shown[part]
                mixed -= blurred
                mixed *= weights[part][..., None]
                mixed += blurred
            yield shown

    def _plan_solver(self, chunk: Chunk, shape: tuple[int, int, int]) -> BurstQuadratic | RowBurst:
        """Plan the solver of all frames together for a chunk whose light has the given shape."""
        engine, threads = self.together.engine, self.options.threads
        if self.options.mode_in_effect != "rowwise":
            banks = [self._drawn(n, chunk) for n in range(1, len(self.frames))]
            wiener = self.strengths.weight is None
            return BurstQuadratic([chunk.bank, *banks], self.shares, shape, wiener=wiener, **engine)
        rows = chunk.source

        def paths(n: int) -> BlurPaths:
            traced = self.frames[n].alignment.every_row(rows.start, rows.stop, self.bank.cols)
            return replace(traced, rows=traced.rows - rows.start)

        every_row = share_map(paths, range(len(self.frames)), threads)
        reach = chunk.bank.size[1] // 2
        return RowBurst(every_row, self.shares, shape, reach=reach, **engine)

    def _drawn(self, n: int, chunk: Chunk) -> PsfBank:
        """Return the PSFs of a frame at the places of a chunk, counted from its first row."""
        paths = self.paths[n]
        first = int(np.searchsorted(paths.rows, chunk.bank.rows[0] + chunk.source.start - 0.5))
        displacements = paths.displacements[first : first + len(chunk.bank.rows)]
        part = BlurPaths(displacements, chunk.bank.rows, chunk.bank.cols, paths.softness)
        return PsfBank.from_paths(part, threads=self.options.threads)


def _paths(frames: Sequence[BurstFrame], rows: FloatArray, cols: FloatArray, *, threads: int | None) -> list[BlurPaths]:
    """Return the paths of the resampled frames on one grid."""
    return share_map(lambda frame: frame.alignment.paths(rows, cols), frames, threads)


def _largest(frames: Sequence[BlurPaths]) -> tuple[int, int]:
    """Return the height and the width that hold every PSF."""
    tall, wide = (max(size_of(paths)[axis] for paths in frames) for axis in (0, 1))
    return tall, wide


def predicted(
    latent: FloatImage, wanted: NDArray[np.bool_], bank: PsfBank, threads: int | None = None
) -> Iterator[tuple[Part, FloatImage]]:
    """Yield the blocks of a sharp picture `latent` (H, W, C), blurred, in which anything is `wanted` (H, W).

    Each is a pair: its rows and columns, and what the frame shows there. `bank` has the PSFs of the frame on the pixels
    of the sharp picture.
    """
    starts = product(*(range(0, n, LONGEST) for n in wanted.shape))
    for part in ((slice(top, top + LONGEST), slice(left, left + LONGEST)) for top, left in starts):
        if not wanted[part].any():
            continue
        whole = _around(part, wanted.shape, bank.size)
        picture, few = np.ascontiguousarray(latent[whole]), bank.cut(*whole)
        few = replace(few, rows=few.rows - whole[0].start, cols=few.cols - whole[1].start)
        blurred = TileBlur(few, picture.shape, threads=threads).forward(picture)
        rows, cols = (slice(p.start - a.start, p.stop - a.start) for p, a in zip(part, whole, strict=True))
        yield part, blurred[rows, cols]


def _around(part: Part, shape: tuple[int, ...], reach: tuple[int, int]) -> Part:
    """Return a part with all that its blur depends on."""
    rows, cols = (
        slice(max(each.start - far, 0), min(each.stop + far, n))
        for each, far, n in zip(part, reach, shape, strict=True)
    )
    return rows, cols
