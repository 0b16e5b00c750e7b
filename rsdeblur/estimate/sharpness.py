"""Comparison of motions by the sharp picture that they lead to.

With the right motion, the gradient of the sharp picture is concentrated in few places; with a wrong one, lines beside
the edges spread it. The measure is l1 / l2 of the gradient, which does not depend on its size: Hurley and Rickard,
"Comparing measures of sparsity", IEEE Trans. Information Theory 55, 2009. Krishnan, Tay and Fergus, CVPR 2011, use it
for blind deconvolution.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsdeblur.deconv.priors import DerivativePrior
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import UNDESCRIBED
from rsdeblur.estimate.spectra import softness
from rsdeblur.estimate.strength import PATH_ERROR, Tuning
from rsdeblur.image.frame import upright
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.types import FloatArray, FloatImage

# Longer side of the picture that is made sharp and least shorter side, px, and the tiles there.
SIDE, LEAST_SIDE, TILES = 640, 64, (8, 4)
# Border that is not compared, px, and the parts along both axes that are measured by themselves.
FRAME, PARTS = 16, (6, 4)
# Gradients below this count as zero.
FAINTEST = 1e-9


class Sharpness:
    """How concentrated the gradient of the sharp picture is under several motions, with the same strength.

    Parameters
    ----------
    light : ndarray, shape (H, W)
        Linear light, of the picture as stored.
    recording : Recording
        Recording of the picture as given, from which the strength follows.
    robust : bool, default False
        Whether parts of the picture are measured by themselves, so that one thing of much contrast does not decide
        alone, and the sharp picture is free of the photo's :func:`~rsdeblur.estimate.spectra.softness` as well, so that
        a longer motion that also undoes some of it does not look better than the right one.
    """

    def __init__(self, light: FloatImage, recording: Recording, *, robust: bool = False) -> None:
        self._scale = scale_of(recording.camera)
        self._softness = softness(self._scale) if robust else 0.0
        self._light = upright(light, recording.camera, self._scale)[..., None]
        self._shares = contrast_shares(_parts(self._light[..., 0])) if robust else None
        tuning = assumed(self._light, self._bank(recording))
        self._nsr, self._prior = tuning.border_error, DerivativePrior("tv", tuning.weight("tv", 1.0))

    def _bank(self, recording: Recording) -> PsfBank:
        rows, cols = (tile_centres(n, size) for n, size in zip(TILES, self._light.shape, strict=False))
        paths = BlurPaths.from_capture(recording.capture(self._scale), rows, cols)
        drawn = PsfBank.from_paths(replace(paths, softness=self._softness), threads=1)
        # Kernels, not paths: the thresholds of `refine` and `sync` were chosen with kernels.
        return PsfBank(drawn.kernels, rows, cols)

    def of(self, recording: Recording) -> float:
        """Return the logarithm of l1 / l2 of the gradient of the sharp picture; infinite without a motion."""
        try:
            bank = self._bank(recording)
        except UNDESCRIBED:
            return np.inf
        # The lines are too short to be worth sharing among threads.
        solver = TileQuadratic(bank, self._light.shape, nsr=self._nsr, threads=1)
        sharp = solver.apply(self._light, prior=self._prior)[..., 0]
        if self._shares is not None:
            return mean_concentration(_parts(sharp), self._shares)
        return concentration(sharp[FRAME:-FRAME, FRAME:-FRAME])


def assumed(light: FloatImage, bank: PsfBank) -> Tuning:
    """Return the measurements of a picture with an assumed error of the paths.

    A measured one would make the strength larger the worse the recording is. The weights are those of a colour picture,
    with which the thresholds of `refine` and `sync` were chosen.
    """
    return replace(Tuning.of(light, bank), path_error=PATH_ERROR**2, channels=3)


def scale_of(camera: Camera, most: float = 1.0) -> float:
    """Return the factor by which pictures of a camera are reduced, at most `most` unless they become too narrow."""
    longer, shorter = max(camera.width, camera.height), min(camera.width, camera.height)
    return min(1.0, max(min(SIDE / longer, most), LEAST_SIDE / shorter))


def concentration(pictures: FloatImage) -> float:
    """Return the logarithm of l1 / l2 of the gradient of pictures, shape (..., H, W), all together."""
    slope = _gradient(pictures)
    return float(np.log(slope.mean() / np.sqrt(np.square(slope).mean())))


def mean_concentration(tiles: FloatImage, shares: FloatArray) -> float:
    """Return the mean of the logarithms of l1 / l2 of the gradient of tiles, shape (N, H, W), with their shares."""
    return float(shares @ concentrations(tiles))


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
    (down, tall), (across, wide) = ((n, side // n) for n, side in zip(PARTS, inside.shape, strict=True))
    grid = inside[: down * tall, : across * wide].reshape(down, tall, across, wide)
    return grid.swapaxes(1, 2).reshape(-1, tall, wide)


def _gradient(pictures: FloatImage) -> FloatImage:
    down, across = (np.diff(pictures, axis=axis) for axis in (-2, -1))
    return np.hypot(down[..., :-1], across[..., :-1, :])


def _root_mean_square(slopes: FloatImage) -> FloatArray:
    squares: FloatArray = np.square(slopes).mean(axis=(1, 2))
    return np.sqrt(squares)
