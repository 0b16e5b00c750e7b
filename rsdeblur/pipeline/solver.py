"""Strengths, and the solver of a picture, which plans one for each chunk of its rows."""

from dataclasses import dataclass, replace
from typing import Any

from rsdeblur.choices import DENOISERS, Chroma
from rsdeblur.deconv.chroma import Solve, half_chroma, half_shape, halved, halved_rows, luma_share, suits_half
from rsdeblur.deconv.plug_and_play import PlugAndPlayPrior, named_denoiser
from rsdeblur.deconv.priors import DerivativePrior, LatentPrior
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.deconv.rowwise import RowDeconvolver
from rsdeblur.deconv.unknown_border import UnknownBorderQuadratic, extended, extended_shape
from rsdeblur.deconv.wiener import Deconvolver
from rsdeblur.errors import InputError
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.pipeline.options import Options
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage, StageProgress


@dataclass(frozen=True, slots=True)
class Strengths:
    """Strengths of a solution, derived from a picture's noise and blur or set by the options."""

    nsr: float
    weight: float | None  # None for the Wiener filter
    peak: float  # value of the picture's bright parts, see `rsdeblur.deconv.priors.brightness`
    tile_nsr: float  # decides the automatic numbers of bands and strips
    noise: float | None = None  # standard deviation in linear light; None where no strength needed it


@dataclass(frozen=True, slots=True)
class Chunk:
    """Rows `source` of the picture, solved for the rows `target` of the result."""

    source: slice
    target: slice
    bank: PsfBank  # PSFs, at places counted from the first row of `source`; "rowwise" traces paths of its own
    half: PsfBank | None = None  # PSFs of the colours at half size; None means those of `halved`


@dataclass(frozen=True, slots=True, eq=False)
class PictureSolver:
    """Solver of one picture; :class:`rsdeblur.burst.solution.BurstSolution` is that of several of a scene together."""

    options: Options
    strengths: Strengths
    bank: PsfBank  # PSFs of the whole picture
    capture: Capture | None = None  # the motion that they come from, which "rowwise" needs

    @property
    def count(self) -> int:
        """Number of pictures that are solved together."""
        return 1

    @property
    def engine(self) -> dict[str, Any]:
        """The settings that every solver takes under the same name."""
        options = self.options
        return {
            "nsr": self.strengths.nsr,
            "border": "periodic" if options.border == "periodic" else "blend",
            "threads": options.threads,
        }

    @property
    def latent_prior(self) -> LatentPrior | None:
        """The prior as the solvers take it; None for the Wiener filter."""
        prior, threads = self.options.prior_in_effect, self.options.threads
        strengths, weight = self.strengths, self.strengths.weight
        if weight is None:
            return None
        if callable(prior):
            return PlugAndPlayPrior(prior, weight, strengths.peak)
        if prior in DENOISERS:
            return PlugAndPlayPrior(named_denoiser(prior, threads), weight, strengths.peak)
        return DerivativePrior(prior, weight, self.options.exponent, strengths.peak)

    def plan(self, chunk: Chunk, shape: tuple[int, int, int]) -> Solve:
        """Plan the solver of a chunk, whose light has the given shape; it restores one picture, with its progress."""
        if self.options.boundary_in_effect is not None:
            return self._open_border(chunk.bank, shape)
        is_rowwise = self.options.mode_in_effect == "rowwise"
        blur = self._every_row(chunk, shape[0]) if is_rowwise else chunk.bank
        if chroma_of(self.options, chunk.bank.size, shape) == "full":
            return self._exact(blur, shape)
        if isinstance(blur, BlurPaths):
            return self._half_chroma(blur, halved_rows(blur), shape)
        return self._half_chroma(blur, chunk.half or halved(blur, threads=self.options.threads), shape)

    def _exact(self, blur: PsfBank | BlurPaths, shape: tuple[int, int, int]) -> Solve:
        """Plan a solver of rows, of which the paths are given, or of tiles."""
        prior = self.latent_prior
        if isinstance(blur, BlurPaths):
            assert self.capture is not None, "the paths come from it"
            # Of all rows of the picture, not only of these; paths between those of the probe are hardly longer.
            width = shape[1]
            longest = float(self.capture.probe.extent[1]) * width / self.capture.camera.width
            reach = min(int(longest) + 2, (width - 1) // 2)
            rows = RowDeconvolver(blur, shape, reach=reach, **self.engine)
            return lambda light, progress: rows.apply(light, prior=prior, progress=progress)
        if prior is None:
            wiener = Deconvolver(blur, shape, **self.engine)
            return lambda light, progress: wiener.apply(light, progress=progress)
        quadratic = TileQuadratic(blur, shape, **self.engine)
        return lambda light, progress: quadratic.apply(light, prior=prior, progress=progress)

    def _half_chroma(self, blur: PsfBank | BlurPaths, half: PsfBank | BlurPaths, shape: tuple[int, int, int]) -> Solve:
        """Plan a solver of the brightness, and one of the picture at half size, which has the blur `half`."""
        threads, strengths = self.options.threads, self.strengths
        share = luma_share(self.options.prior_in_effect, self.options.exponent)
        if strengths.weight is None:
            own = replace(strengths, nsr=share * strengths.nsr)
        else:
            own = replace(strengths, weight=share * strengths.weight)
        luma = replace(self, strengths=own)
        exact = luma._exact(blur, (*shape[:2], 1)), self._exact(half, half_shape(shape))
        return half_chroma(*exact, peak=strengths.peak, threads=threads)

    def _open_border(self, bank: PsfBank, shape: tuple[int, int, int]) -> Solve:
        """Plan a solver for which what lies beyond the frame is unknown."""
        (height, width, _), prior = shape, self.latent_prior
        assert prior is not None, "Options refuses the Wiener filter"
        unknown = UnknownBorderQuadratic(
            bank,
            extended_shape(shape, bank),
            recorded=(height, width),
            nsr=self.strengths.nsr,
            threads=self.options.threads,
        )

        def solve(light: FloatImage, progress: StageProgress) -> FloatImage:
            restored = unknown.apply(extended(light, bank), prior=prior, progress=progress)
            return restored[:height, :width]

        return solve

    def _every_row(self, chunk: Chunk, height: int) -> BlurPaths:
        """Trace the paths of the rows of a chunk."""
        if self.capture is None:
            raise InputError('mode="rowwise" has no tiles')
        first = chunk.source.start
        paths = BlurPaths.every_row(self.capture, chunk.bank.cols, within=slice(first, first + height))
        return replace(paths, rows=paths.rows - first)


def chroma_of(options: Options, size: tuple[int, int], shape: tuple[int, int, int]) -> Chroma:
    """Return the resolution of the colours of pictures (H, W, C), restored with kernels of a size (px)."""
    return "half" if options.chroma_in_effect == "half" and suits_half(size, shape) else "full"
