"""Aligned frames of a burst, solved together chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.burst.alignment import AlignedBurst, combined
from rsdeblur.burst.frames import BurstFrame
from rsdeblur.choices import EXPONENT
from rsdeblur.deconv.chroma import Solve
from rsdeblur.deconv.priors import brightness
from rsdeblur.deconv.quadratic import TileNormal
from rsdeblur.deconv.rowwise import RowSolver
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.motion.alignment import paths_between
from rsdeblur.pipeline.memory import least_memory
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.solver import Chunk, PictureSolver
from rsdeblur.pipeline.steps import tuned_strengths
from rsdeblur.pipeline.tiles import tile_errors, tile_paths
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.tuning.strength import KERNELS, BlurSpectra
from rsdeblur.types import FloatArray, FloatImage, StageProgress

# Mean weight over a whole frame from which on it shows the same scene everywhere.
ALIKE = 0.99
# Bytes that the solve may use by default. The default grows to this multiple of what the smallest chunks need.
MEMORY, ABOVE_LEAST = 1 << 30, {"global": 1.1, "banded": 1.1, "rowwise": 1.25}


@dataclass(frozen=True, slots=True, eq=False)
class BurstSolution(PictureSolver):
    """Solver of the frames of a burst, with PSFs of one size; the reference comes first, and `bank` is its own."""

    frames: tuple[BurstFrame, ...] = ()
    banks: tuple[PsfBank, ...] = ()
    shares: tuple[float, ...] = ()
    # The solver of the reference, where other frames do not show the scene.
    single: PictureSolver | None = None

    @classmethod
    def of(cls, burst: AlignedBurst, options: Options) -> BurstSolution:
        """Derive the shares and strengths of the frames that contribute, and their PSFs."""
        frames, mode = tuple(burst.frames[n] for n in burst.used), options.mode_in_effect
        height, width, _ = burst.reference.encoded.shape
        few = _banks(frames, *(tile_centres(min(KERNELS, n), n) for n in (height, width)), threads=options.threads)
        spectra = [BlurSpectra.of(bank, one_filter=options.has_one_psf) for bank in few]
        tunings = [replace(frame.tuning, spectra=of) for frame, of in zip(frames, spectra, strict=True)]
        captures = [frame.capture for frame in frames]
        in_tiles = mode == "banded" and not options.has_one_psf
        tuning, shares = combined(tunings, [sum(tile_errors(each)) if in_tiles else 0.0 for each in captures])
        peak = brightness(burst.reference.split.remainder(slice(None), 4))
        strengths = tuned_strengths(tuning, options, peak)
        # Where other frames do not show the scene, they repeat the result of the reference alone. For narrow margins, a
        # Wiener filter is good enough; for things that move, it costs up to 0.6 dB (tv, eight simulated bursts).
        alike = len(frames) > 1 and all(frame.fit is None or frame.fit.weights.mean() > ALIKE for frame in frames)
        simple = replace(options, prior="wiener", nsr="auto", weight="auto", exponent=EXPONENT) if alike else options
        alone = tuned_strengths(tunings[0], simple, peak)
        tiles = mode, options.bands, options.strips, strengths.tile_nsr
        traced = share_map(lambda capture: tile_paths(capture, *tiles), captures, options.threads)
        bands, strips = (max(len(getattr(paths, axis)) for paths in traced) for axis in ("rows", "cols"))
        places = tile_centres(bands, height), tile_centres(strips, width)
        banks = _banks(frames, *places, threads=options.threads)
        own = PictureSolver(replace(simple, chroma="full"), alone, banks[0], captures[0])
        solution = cls(
            *(replace(options, chroma="full"), strengths, banks[0], captures[0]),
            frames=frames,
            banks=tuple(banks),
            shares=shares,
            single=own,
        )
        if options.geometry == "rectify" or options.normalize:
            return solution
        memory = options.max_memory
        if memory is None:
            # The default grows to a multiple of the least rather than refuse the burst or cut it into thin chunks.
            memory = max(MEMORY, int(ABOVE_LEAST[mode] * least_memory(solution, burst.reference.encoded.shape)))
        # The highlights are separated already.
        return replace(solution, options=replace(solution.options, max_memory=memory, saturation="ignore"))

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.frames)

    def plan(self, chunk: Chunk, shape: tuple[int, int, int]) -> Solve:
        """Plan the solver of a chunk, see :class:`rsdeblur.pipeline.solver.PictureSolver`."""
        del shape  # that of the light
        return partial(self._solve, chunk)

    def _solve(self, chunk: Chunk, light: FloatImage, progress: StageProgress) -> FloatImage:
        """Return the sharp light of a chunk of rows; `light` is that of the reference, which is solved alone first."""
        assert self.single is not None, "a burst has a reference"
        alone = self.single.plan(chunk, light.shape)
        single = alone(light, lambda share: progress(share / 3))
        if len(self.frames) == 1:
            return single
        # Free its memory before the next solver is planned.
        del alone
        banks = [bank.cut(chunk.source, slice(0, light.shape[1])) for bank in self.banks]
        return self._planned(chunk, banks, light.shape).combine(
            self._lights(chunk, banks, light, single),
            prior=self.latent_prior,
            progress=lambda share: progress((1 + 2 * share) / 3),
        )

    def _planned(self, chunk: Chunk, banks: Sequence[PsfBank], shape: tuple[int, ...]) -> TileNormal | RowSolver:
        """Plan the solver of all frames together."""
        engine = self.engine
        if self.options.mode_in_effect != "rowwise":
            return TileNormal(banks, self.shares, shape, wiener=self.strengths.weight is None, **engine)
        every_row = share_map(
            lambda frame: paths_between(frame.capture, frame.reference, chunk.source, chunk.bank.cols),
            self.frames,
            self.options.threads,
        )
        return RowSolver(every_row, self.shares, shape, reach=chunk.bank.size[1] // 2, **engine)

    def _lights(
        self, chunk: Chunk, banks: Sequence[PsfBank], light: FloatImage, single: FloatImage
    ) -> Iterator[FloatImage]:
        """Yield the light of all frames at the rows of a chunk of the reference, that of the reference first."""
        yield light
        # Where another frame does not show its scene, pixels are those that `single`, the reference's own solution,
        # predicts. So they neither help nor harm, and priors see whole pictures.
        threads = self.options.threads
        for frame, bank in zip(self.frames[1:], banks[1:], strict=True):
            shown, weights = frame.light(chunk.source, threads)
            if (weights < 1).any():
                blurred = TileBlur(bank, single.shape, threads=threads).forward(single)
                # predicted + weights (shown - predicted)
                shown -= blurred
                shown *= weights[..., None]
                shown += blurred
            yield shown


def _banks(frames: Sequence[BurstFrame], rows: FloatArray, cols: FloatArray, *, threads: int | None) -> list[PsfBank]:
    """Return the PSFs of the resampled frames on one grid, as large as the largest ones."""
    paths = share_map(lambda frame: frame.paths(rows, cols), frames, threads)
    banks = [PsfBank.from_paths(each, threads=threads) for each in paths]
    tall, wide = np.max([bank.size for bank in banks], axis=0).tolist()
    return [bank.padded((tall, wide)) for bank in banks]
