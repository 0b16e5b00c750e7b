"""Comparison of motions by the sharp picture that they lead to.

With the right motion, the gradient of the sharp picture is concentrated in few places; with a wrong one, lines beside
the edges spread it. The measure is l1 / l2 of the gradient, which does not depend on its size: Hurley and Rickard,
"Comparing measures of sparsity", IEEE Trans. Information Theory 55, 2009. Krishnan, Tay and Fergus, CVPR 2011, use it
for blind deconvolution. Tiles or parts of the picture are measured by themselves, so that one thing of much contrast
does not decide alone. The sharp picture is free of the photo's softness as well: otherwise a longer motion that also
undoes some of it would look better than the right one.

:class:`QuickSharpness`, for a search, takes the first steps of total variation in tiles whose spectra serve for all
motions. :class:`WholeSharpness`, for the few motions that a search finds, solves the whole picture.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsdeblur._util.threads import share_map
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling, DerivativePrior, brightness
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import LONGEST_BLUR, UNDESCRIBED, softness
from rsdeblur.image.encoded import upright
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.tuning.noise import TILE, wrapped
from rsdeblur.tuning.strength import PATH_ERROR, Tuning
from rsdeblur.types import ComplexArray, FloatArray, FloatImage

# Longer side of the picture that is made sharp, px.
SIDE = 640
# Tiles along both axes that are compared, and the length over which their opposite ends fade into each other: in PSF
# sizes, and at most as a share of the picture.
TILES, FADE, MOST_FADE = (6, 4), 5.0, 0.3
# Border that is not compared, px.
FRAME = 16
# Gradients below this count as zero.
FAINTEST = 1e-9
# Penalties of the steps of total variation, which do not extrapolate: more steps distinguish motions no better.
PENALTIES = (5.0, 14.0)
# Nats of the spectra that a fall of the logarithm of l1 / l2 is worth.
NATS_PER_FALL = 1000.0
# Share of the length of other paths below which it favours the shorter ones: less deblurring leaves fewer waves.
SHORTER = 0.85


def captured(moving: Recording | Capture, scale: float = 1.0) -> Capture:
    """Return a capture, or that of a recording, of the upright picture reduced by a factor."""
    if isinstance(moving, Recording):
        return moving.capture(scale)
    if scale == 1.0 and moving.softness == 0.0:
        return moving  # it may have its probe already
    # In the reduced picture, a softness of up to 1 px hardly counts.
    return replace(moving, camera=moving.camera.scaled(scale), softness=0.0)


class QuickSharpness:
    """How concentrated the gradient of the sharp picture is under several motions, with the same strength.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced, but not below 640 px. The strength
    follows from `recording`, the one given. A capture in its place belongs to an upright picture.
    """

    def __init__(self, light: FloatImage, recording: Recording | Capture) -> None:
        length = max(captured(recording).mean_length, 1.0)
        self._scale = scale_of(recording.camera, LONGEST_BLUR / length)
        light = upright(light, recording.camera, self._scale)
        rows, cols = (tile_centres(count, side) for count, side in zip(TILES, light.shape, strict=True))
        # So few PSFs are drawn sooner than threads start.
        bank = PsfBank.from_paths(self._paths(recording, rows, cols), threads=1)
        tuning = assumed(light[..., None], bank)
        self._tiles = _RepeatingTiles(light, bank.size, nsr=tuning.border_error, softness=softness(self._scale))
        self._shares = contrast_shares(self._tiles.observed_parts)
        down, across = self._tiles.centres
        #: Centres of the rows and columns of tiles, as shares of the upright picture's height and width.
        self.centres = down / light.shape[0], across / light.shape[1]
        self._prior = DerivativePrior("tv", tuning.weight("tv", 1.0), peak=brightness(light))

    def _paths(self, recording: Recording | Capture, rows: FloatArray, cols: FloatArray) -> BlurPaths:
        return BlurPaths.from_capture(captured(recording, self._scale), rows, cols)

    def tiles(self, recording: Recording) -> FloatArray:
        """Return what each tile contributes to the mean logarithm of l1 / l2 of the gradient, shape (N,)."""
        return self._under(self._paths(recording, *self._tiles.centres))

    def under(self, capture: Capture, motions: Sequence[FloatArray | float], *, threads: int | None) -> list[float]:
        """Return the mean over the tiles with each of several motions, which threads share.

        A motion is a path that all pixels have, px of the upright picture, shape (T, 2), or a factor on the paths.
        """
        own = self._paths(capture, *self._tiles.centres)

        def measure(other: FloatArray | float) -> float:
            if isinstance(other, float):
                displacements = other * own.displacements
            else:
                displacements = np.broadcast_to(self._scale * other, (*own.displacements.shape[:2], *other.shape))
            return float(self._under(replace(own, displacements=displacements)).sum())

        return share_map(measure, motions, threads)

    def _under(self, paths: BlurPaths) -> FloatArray:
        solver = _RepeatingSolver(self._tiles, self._tiles.otfs(PsfBank.from_paths(paths, threads=1).kernels))
        *_, (sharp, _) = self._prior.steps(solver, penalties=PENALTIES, ahead=0.0, threads=1)
        return self._shares * concentrations(self._tiles.parts(sharp))


class WholeSharpness:
    """How concentrated the gradient of the sharp picture is under several motions, if the whole picture is solved."""

    def __init__(self, light: FloatImage, recording: Recording) -> None:
        self._scale = scale_of(recording.camera)
        self._light = upright(light, recording.camera, self._scale)[..., None]
        self._shares = contrast_shares(_parts(self._light[..., 0]))
        tuning = assumed(self._light, self._bank(recording))
        self._nsr, self._prior = tuning.border_error, DerivativePrior("tv", tuning.weight("tv", 1.0))

    def _bank(self, recording: Recording) -> PsfBank:
        rows, cols = tile_centres(8, self._light.shape[0]), tile_centres(4, self._light.shape[1])
        paths = BlurPaths.from_capture(recording.capture(self._scale), rows, cols)
        drawn = PsfBank.from_paths(replace(paths, softness=softness(self._scale)), threads=1)
        # Kernels, not paths: the thresholds of `refine` were chosen with kernels.
        return PsfBank(drawn.kernels, rows, cols)

    def of(self, recording: Recording) -> float:
        """Return the mean logarithm of l1 / l2 of the gradient of the sharp parts; infinite without a motion."""
        try:
            bank = self._bank(recording)
        except UNDESCRIBED:
            return np.inf
        # The lines are too short to be worth sharing among threads.
        solver = TileQuadratic(bank, self._light.shape, nsr=self._nsr, threads=1)
        sharp = solver.apply(self._light, prior=self._prior)[..., 0]
        return float(self._shares @ concentrations(_parts(sharp)))


class _RepeatingTiles:
    """Tiles of a picture (H, W) that repeat; `size` is that of the PSFs, `nsr` that of :class:`TileQuadratic`.

    Opposite ends of a tile fade into each other, whatever its PSF, so that a tile's spectrum serves for all motions.
    The PSFs are taken under a Gaussian with the standard deviation `softness`, px.
    """

    def __init__(self, light: NDArray[np.float32], size: tuple[int, int], *, nsr: float, softness: float) -> None:
        sides = list(zip(light.shape, TILES, size, strict=True))
        fades = [int(min(FADE * reach, MOST_FADE * side)) for side, _, reach in sides]
        self.shape = tuple(
            min(fft.next_fast_len(-(-(side - 2 * fade) // count) + fade, real=True), side - fade)
            for (side, count, _), fade in zip(sides, fades, strict=True)
        )
        spans = [period + fade for period, fade in zip(self.shape, fades, strict=True)]
        tops, lefts = (
            np.round(np.linspace(0, side - span, count)).astype(np.intp)
            for (side, count, _), span in zip(sides, spans, strict=True)
        )
        self.centres = tops + (spans[0] - 1) / 2, lefts + (spans[1] - 1) / 2
        self._parts = tuple(
            slice(fade - fade // 2, period - fade // 2) for fade, period in zip(fades, self.shape, strict=True)
        )
        tiles = np.lib.stride_tricks.sliding_window_view(light, spans)[np.ix_(tops, lefts)].reshape(-1, *spans)
        for axis, fade in enumerate(fades, 1):
            tiles = _faded(tiles, axis, fade)
        #: What the tiles show of the blurred picture, shape (N, h, w).
        self.observed_parts = self.parts(tiles)
        self.observed: NDArray[np.complex64] = fft.rfft2(tiles)
        self.nsr = np.float32(nsr)
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        frequencies = fft.fftfreq(self.shape[0]), fft.rfftfreq(self.shape[1])
        squared = np.add.outer(*(np.square(f) for f in frequencies))
        self._softening = np.exp(-0.5 * (2 * np.pi * softness) ** 2 * squared).astype(np.float32)
        self.differences = np.add.outer(*(4 * np.sin(np.pi * f) ** 2 for f in frequencies)).astype(np.float32)

    def otfs(self, kernels: NDArray[np.float32]) -> ComplexArray:
        """Return the OTFs of all tiles, shape (N, H, F), from their PSFs, shape (B, S, kh, kw)."""
        bands, strips, height, width = kernels.shape
        grid = wrapped(kernels, self.shape).reshape(bands * strips, *self.shape)
        centred = np.roll(grid, (-(height // 2), -(width // 2)), axis=(1, 2))
        otfs: ComplexArray = self._softening * fft.rfft2(centred)
        return otfs

    def parts(self, latent: FloatImage) -> FloatImage:
        """Return what the tiles show of the picture, without the ends that fade, shape (N, h, w)."""
        return latent.reshape(-1, *self.shape)[:, *self._parts]


class _RepeatingSolver:
    """Solver of tiles that repeat, under their OTFs; its latent picture is a column of all of them."""

    periodic = True

    def __init__(self, tiles: _RepeatingTiles, otfs: ComplexArray) -> None:
        self._tiles = tiles
        # Factors and right-hand sides of the normal equations without a prior.
        self._power = np.square(otfs.real) + np.square(otfs.imag) + tiles.nsr
        self._data = (1 + tiles.nsr) * otfs.conj() * tiles.observed

    def solve(
        self,
        beta: float,
        pull: FloatImage | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: FloatImage | None = None,
    ) -> FloatImage:
        """Return the minimiser, see :class:`rsdeblur.deconv.priors.QuadraticSolver`."""
        shape = self._tiles.shape
        inverse = 1 / (self._power + np.float32(beta) * coupling.response(self._tiles.differences))
        if pull is None:
            signal = self._data * inverse
        else:
            signal = fft.rfft2(pull.reshape(-1, *shape))
            signal *= np.float32(beta)
            signal += self._data
            signal *= inverse
        latent = fft.irfft2(signal, shape, overwrite_x=True)
        return np.ascontiguousarray(latent.reshape(-1, shape[1], 1))


def _faded(tiles: NDArray[np.float32], axis: int, fade: int) -> NDArray[np.float32]:
    """Return tiles that repeat along an axis: their last `fade` values fade into the first ones."""
    tiles = np.moveaxis(tiles, axis, -1)
    period = tiles.shape[-1] - fade
    rising = np.sin(0.5 * np.pi * (np.arange(fade, dtype=np.float32) + 0.5) / fade) ** 2
    first = rising * tiles[..., :fade] + (1 - rising) * tiles[..., period:]
    # The faded values lie half before the end and half after the beginning.
    faded = np.roll(np.concatenate([first, tiles[..., fade:period]], axis=-1), -(fade // 2), axis=-1)
    return np.moveaxis(faded, -1, axis)


def assumed(light: FloatImage, bank: PsfBank) -> Tuning:
    """Return the measurements of a picture with an assumed error of the paths.

    A measured one would make the strength larger the worse the recording is. The weights are those of a colour picture,
    with which the thresholds of `refine` were chosen.
    """
    return replace(Tuning.of(light, bank), path_error=PATH_ERROR**2, channels=3)


def scale_of(camera: Camera, most: float = 1.0) -> float:
    """Return the factor by which pictures of a camera are reduced: at most `most`, but not narrower than a tile."""
    longer, shorter = max(camera.width, camera.height), min(camera.width, camera.height)
    return min(1.0, max(min(SIDE / longer, most), TILE / shorter))


def concentrations(tiles: FloatImage) -> FloatArray:
    """Return the logarithms of l1 / l2 of the gradient of tiles, shape (N, H, W)."""
    slope = _gradient(tiles)
    spread = slope.mean(axis=(1, 2)) / np.maximum(_root_mean_square(slope), FAINTEST)
    logarithms: FloatArray = np.log(np.maximum(spread, FAINTEST))
    return logarithms


def contrast_shares(tiles: FloatImage) -> FloatArray:
    """Return the shares of tiles of a blurred picture, shape (N, H, W), in its contrast."""
    contrast = _root_mean_square(_gradient(tiles))
    return contrast / max(float(contrast.sum()), FAINTEST)


def _parts(picture: FloatImage) -> FloatImage:
    """Return equal parts of a picture within the frame, shape (N, h, w)."""
    inside = picture[FRAME:-FRAME, FRAME:-FRAME]
    (down, tall), (across, wide) = ((n, side // n) for n, side in zip(TILES, inside.shape, strict=True))
    grid = inside[: down * tall, : across * wide].reshape(down, tall, across, wide)
    return grid.swapaxes(1, 2).reshape(-1, tall, wide)


def _gradient(pictures: FloatImage) -> FloatImage:
    down, across = (np.diff(pictures, axis=axis) for axis in (-2, -1))
    return np.hypot(down[..., :-1], across[..., :-1, :])


def _root_mean_square(slopes: FloatImage) -> FloatArray:
    squares: FloatArray = np.square(slopes).mean(axis=(1, 2))
    return np.sqrt(squares)
