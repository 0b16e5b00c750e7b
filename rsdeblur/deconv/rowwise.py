"""The exact rolling-shutter solve: every row has its own PSF.

For each frequency along x the blur is a banded matrix A along y (:mod:`rsdeblur.deconv.rowwise_blur`), so

    minimise |A u - g|^2 + nsr |u - m|^2 + beta |grad u - w|^2

is a banded Hermitian positive definite system: the gradient term is diagonal along x and tridiagonal along y; second
derivatives in its place are pentadiagonal along y, and the picture itself is diagonal. Where the data do not determine
u, it falls back on m, the expectation: the picture's mean. Without a prior, near top and bottom it is the smoothed
average of the outermost rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import BORDERS, Border
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling, LatentPrior
from rsdeblur.deconv.rowwise_blur import RowSpectra, latent_rows, strip_blurs
from rsdeblur.deconv.scene import SceneSolver
from rsdeblur.deconv.tiling import Tile, Tiling
from rsdeblur.deconv.wiener import LEAST_NSR, decay_margin
from rsdeblur.errors import InputError
from rsdeblur.kernels import rowwise
from rsdeblur.kernels.rowwise import LANES
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.types import Float32Array, FloatImage

# Largest margin of a strip, in PSF widths: the tiny `nsr` of gradient priors would ask for a hundred.
MOST_MARGIN = 3.0
# Expectation beyond top and bottom: the average of this many outermost rows, smoothed along x by a Gaussian whose
# standard deviation is as many px.
EDGE_ROWS = 4
# Inside the frame the expectation fades to the mean over this many rows more than paths reach beyond the frame.
EDGE_FADE = 16
# Frequencies that the smoothing reduces to a smaller share than this are expected to be zero.
LEAST_EXPECTED = 1e-3
# Bytes of normal matrices of several frames that a prior's steps keep: those of the first frequencies. The others are
# computed anew in every step. A strip of 480 px of 1500 rows needs 75 MiB for paths 40 rows tall; much more would mean
# smaller chunks in bounded memory.
ASSEMBLED_BYTES = 64 << 20

# What the steps of a prior have in common, by block of frequencies: the observation sent back along the paths, and the
# assembled normal matrix.
Kept = dict[int, tuple[Float32Array, Float32Array]]


class RowSolver(SceneSolver):
    """Base of the rowwise solvers: minimises `sum_i a_i |A_i u - g_i|^2 + nsr |u - m|^2` for the frames of one scene.

    Frames and their blurs are multiplied by the roots of the shares a_i, which sum to 1. Of N frames, row y of frame i
    is row N y + i of a picture N times as tall. So the normal matrix is the sum of those of the frames; its bandwidth
    is that of the tallest paths. Other arguments are those of :class:`rsdeblur.deconv.RowDeconvolver`.

    While a picture is solved, it is a :class:`rsdeblur.deconv.priors.QuadraticSolver` of one strip after another. With
    a prior m is the picture's mean. Rows beyond the frame are unknowns, so no difference crosses an end. The difference
    of g from the blurred m counts (1 + nsr) times, so that contrast does not depend on nsr.
    """

    periodic = False

    def __init__(
        self,
        frames: Sequence[BlurPaths],
        shares: Sequence[float],
        shape: tuple[int, ...],
        *,
        nsr: float,
        reach: int,
        border: Border,
        threads: int | None,
    ) -> None:
        self.shape = validate.shape(shape)
        self.nsr = max(validate.strength("nsr", nsr), LEAST_NSR)
        validate.choice("border", border, BORDERS)
        height, width = self.shape[:2]
        self.top, latents = latent_rows(*frames)
        self._factors = tuple(float(share) ** 0.5 for share in shares)
        self._reach = max(reach, *(int(np.floor(paths.extent[1])) + 1 for paths in frames))
        if len(frames[0].rows) != height:
            raise InputError(f"paths are those of {len(frames[0].rows)} rows, the picture has {height}")
        kernel = 2 * self._reach + 1
        if kernel > width:
            raise InputError(f"the paths reach {self._reach} px sideways, more than the picture of {width} px can hold")
        margin = int(np.ceil(min(decay_margin(self.nsr), MOST_MARGIN) * kernel))
        self._wraps = border == "periodic"
        cols = frames[0].cols
        self._tiling = Tiling.plan(cols, width, kernel, margin, periodic=self._wraps)
        threads = thread_count(threads)
        self._strips = strip_blurs(frames, self._factors, self.top, latents, threads)
        channels = self.shape[2] if len(self.shape) == 3 else 1
        self._spectra = RowSpectra(channels, self._tiling.length, threads=threads)
        self._team = self._spectra.team
        self._data, self._latent = self._spectra.empty(len(frames) * height), self._spectra.empty(latents)
        blocks = range(self._spectra.blocks)
        self._tables = [[strip.table(b, self._spectra.length) for b in blocks] for strip in self._strips]
        floats = max(strip.workspace_size(solve=True) for strip in self._strips)
        self._workspaces: list[Float32Array] = [empty((floats,), np.float32) for _ in range(self._team.threads)]
        # The strip that is solved, and what the steps of a prior have in common.
        self._strip, self._kept = 0, Kept()
        # Floats of the assembled normal matrix of each strip.
        self._assembled_sizes = [rowwise.assembled_size(s.model, s.table(0, 1), s.rows) for s in self._strips]

    def observe(self, frame: int, picture: FloatImage) -> None:
        """Take in a frame, see :class:`rsdeblur.deconv.scene.SceneSolver`."""
        frames, (height, width, channels) = len(self._factors), picture.shape
        if frames == 1:
            self._rows = picture
            return
        if frame == 0:
            self._rows = np.empty((height * frames, width, channels), dtype=np.float32)
        np.multiply(picture, np.float32(self._factors[frame]), out=self._rows[frame::frames])

    def _restored(self, prior: LatentPrior | None, progress: Callable[[float], None] | None) -> FloatImage:
        strips, several = len(self._strips), len(self._strips) > 1
        out = np.zeros((*self.shape[:2], self._spectra.channels), dtype=np.float32)
        for s, tile in enumerate(self._tiling.tiles):
            report = None if progress is None else partial(_report, progress, s, strips)
            self._strip, self._kept = s, {}
            self._spectra.load(self._rows, self._data, start=tile.start, taper=self._tiling.taper, periodic=self._wraps)
            if prior is None:
                self._solve(0.0, TO_GRADIENT, pull=False, edges=True)
                self._spectra.unload(self._latent, -self.top, out, tile, add=several)
                if report is not None:
                    report(1.0)
            else:
                latent = prior.restore(self, threads=self._team.threads, progress=report)
                first, count = tile.first - tile.start, len(tile.weights)
                shown = latent[-self.top : len(out) - self.top, first : first + count]
                out[:, tile.first : tile.first + count] += tile.weights[:, None] * shown
        del self._rows
        return out

    def solve(
        self,
        beta: float,
        pull: Float32Array | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: Float32Array | None = None,
    ) -> Float32Array:
        """Return the latent picture of the strip that is solved, from row :attr:`top` on and with its padded width.

        `out` may be `pull`; see :meth:`rsdeblur.deconv.priors.QuadraticSolver.solve`.
        """
        length = self._spectra.length
        if pull is not None:
            self._spectra.load(pull, self._latent)
        self._solve(beta, coupling, pull=pull is not None, edges=False)
        out = np.empty((self._latent.shape[2], length, self._spectra.channels), np.float32) if out is None else out
        self._spectra.unload(self._latent, 0, out, Tile(0, 0, np.ones(length, dtype=np.float32)))
        return out

    def _solve(self, beta: float, coupling: Coupling, *, pull: bool, edges: bool) -> None:
        """Minimise for all frequencies of the strip, and leave the result in the latent spectra.

        With `pull`, the latent spectra hold the pull of a prior, which enters the right-hand side. With `edges`, m has
        the outermost rows.
        """
        strip, kept = self._strip, self._kept
        model, tables = self._strips[strip].model, self._tables[strip]
        weights = self._penalty(beta, coupling)
        # The difference u - m is scaled in the end, so that no motion is the identity at any nsr.
        scale = 1.0 + self.nsr

        def block(thread: int, b: int) -> None:
            data, latent, workspace = self._data[b], self._latent[b], self._workspaces[thread]
            penalty = weights[b]
            expected = self._expectation(b, edges=edges)
            if not pull:
                latent[...] = 0
            else:
                # The unknown is u - m, and the derivatives of m are zero.
                if coupling.picture and expected is not None:
                    latent -= np.float32(coupling.picture) * expected
                latent *= np.float32(beta / scale)
            if not edges and self._keeps(strip, b):
                if b not in kept:
                    kept[b] = self._assembled(strip, b, expected, workspace)
                right, normal = kept[b]
                latent += right
                rowwise.solve_assembled(model, tables[b], normal, latent, workspace, penalty, data.shape[1])
            else:
                rest = self._rest(strip, b, expected, workspace)
                rowwise.solve(model, tables[b], rest, latent, workspace, penalty)
            latent *= scale
            if expected is not None:
                latent += expected

        self._team.share(block, range(self._spectra.blocks))

    def _penalty(self, beta: float, coupling: Coupling) -> Float32Array:
        """Return the weights (blocks, 3, 16) of `|u - m|^2`, `|D u|^2` and `|D^T D u|^2`, D along y, per frequency.

        `|D|^2` in both directions is the sum of both, so its square has a mixed term.
        """
        turns = np.arange(self._spectra.blocks * LANES).reshape(-1, LANES) / self._spectra.length
        across = (2 - 2 * np.cos(2 * np.pi * turns)).astype(np.float32)
        _, gradient, bend = coupling
        slope = gradient + 2 * bend * across
        parts = self.nsr + beta * coupling.response(across), beta * slope, np.full_like(across, beta * bend)
        return np.stack(parts, axis=1).astype(np.float32)

    def _keeps(self, strip: int, block: int) -> bool:
        """Whether the steps of a prior keep the normal matrix of a block of frequencies.

        With one frame that gains nothing: reading it takes as long as computing it, because the blur is in the cache.
        """
        return len(self._factors) > 1 and (block + 1) * 4 * self._assembled_sizes[strip] <= ASSEMBLED_BYTES

    def _assembled(
        self, strip: int, block: int, expected: Float32Array | None, workspace: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        blur, table = self._strips[strip], self._tables[strip][block]
        normal = np.empty(self._assembled_sizes[strip], dtype=np.float32)
        rowwise.assemble(blur.model, table, normal, workspace, blur.rows)
        right: Float32Array = np.empty_like(self._latent[block])
        rowwise.adjoint(blur.model, table, self._rest(strip, block, expected, workspace), right, workspace)
        return right, normal

    def _rest(self, strip: int, block: int, expected: Float32Array | None, workspace: Float32Array) -> Float32Array:
        """Return the observation without the blurred expectation."""
        data: Float32Array = self._data[block]
        if expected is None:
            return data
        blurred: Float32Array = np.empty_like(data)
        rowwise.forward(self._strips[strip].model, self._tables[strip][block], blurred, expected, workspace)
        return np.subtract(data, blurred, out=blurred)

    def _expectation(self, block: int, *, edges: bool) -> Float32Array | None:
        """Return the spectra of m in one block, without `edges` those of the mean; None where they are next to zero."""
        frequency = (block * LANES + np.arange(LANES)) / self._spectra.length
        left = np.exp(-2 * (np.pi * EDGE_ROWS * frequency) ** 2).astype(np.float32)
        if left[0] < LEAST_EXPECTED or (block > 0 and not edges):
            return None
        factors, (channels, rows, *lanes) = np.array(self._factors, np.float32), self._data[block].shape
        frames = self._data[block].reshape(channels, rows // len(factors), len(factors), *lanes)
        data = np.einsum("n,chnkl->chkl", factors, frames)
        mean = np.zeros_like(data[:, :1])
        if block == 0:
            mean[..., 0, 0] = data[:, :, 0, 0].mean(axis=1, keepdims=True)
        if not edges:
            return np.repeat(mean, self._latent.shape[2], axis=1)
        first, last = (left * (rows.mean(axis=1) - mean[:, 0]) for rows in (data[:, :EDGE_ROWS], data[:, -EDGE_ROWS:]))
        expected = np.repeat(mean, self._latent.shape[2], axis=1)
        # Positions are counted from the first and from the last row of the frame; beyond the frame the weight is 1.
        above = _fading(self.top, EDGE_FADE - self.top)
        below = _fading(data.shape[1] - self.top - expected.shape[1], EDGE_FADE - self.top)
        expected[:, : len(above)] += (above * first[:, None])[:, : expected.shape[1]]
        expected[:, ::-1][:, : len(below)] += (below * last[:, None])[:, : expected.shape[1]]
        return expected


def _report(progress: Callable[[float], None], part: int, parts: int, fraction: float) -> None:
    progress((part + fraction) / parts)


def _fading(first: int, length: int) -> Float32Array:
    """Return weights (n, 1, 1) for positions from `first` on: 1 up to position 0, falling to 0 at `length`."""
    positions = np.arange(first, length, dtype=np.float32)
    return (0.5 + 0.5 * np.cos(np.pi * positions.clip(0) / length)).astype(np.float32)[:, None, None]


@one_line("shape", "nsr")
class RowDeconvolver(RowSolver):
    """Deconvolution with the PSF of every row, planned once and applied often.

    Minimises `|A u - g|^2 + nsr |u - m|^2` exactly. A is :class:`rsdeblur.deconv.RowBlur`; m is the picture's mean and,
    near top and bottom, the smoothed average of its outermost rows. The difference u - m is then multiplied by
    (1 + nsr). With this factor no motion is the identity, and a constant picture keeps its brightness.

    Parameters
    ----------
    paths : BlurPaths
        Paths of every row of the picture (:meth:`rsdeblur.motion.BlurPaths.every_row`), in one or more strips.
    shape : (H, W) or (H, W, C)
        Shape of the pictures.
    nsr : float, default 0.01
        Noise-to-signal power ratio Phi, from 1e-20 to 1e20; less than 1e-6, the limit of float32, counts as 1e-6.
    reach : int, default 0
        Least reach of the paths along x, px, for which the continuation of the picture is planned: where the rows are a
        part of a picture, that of its longest path, so that all parts are continued alike.
    border : {"blend", "periodic"}
        How the picture continues along x, see :class:`rsdeblur.Deconvolver`. Along y, rows beyond the frame are
        unknowns.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Attributes
    ----------
    top : int
        Row of the picture at which the first latent row lies; 0 or less.

    Raises
    ------
    InputError
        If `paths` are not those of the picture's rows or reach further than the picture, or an argument is out of
        range.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> paths = rsdeblur.motion.BlurPaths.every_row(capture, cols=[31.5])
    >>> rsdeblur.deconv.RowDeconvolver(paths, (48, 64)).apply(np.full((48, 64), 0.5)).shape
    (48, 64)
    """

    def __init__(
        self,
        paths: BlurPaths,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.01,
        reach: int = 0,
        border: Border = "blend",
        threads: int | None = None,
    ) -> None:
        validate.instance("paths", paths, BlurPaths)
        reach = validate.count("reach", reach, minimum=0)
        super().__init__([paths], [1.0], shape, nsr=nsr, reach=reach, border=border, threads=threads)
