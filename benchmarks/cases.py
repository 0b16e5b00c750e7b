"""The speed benchmarks' pictures and PSFs, which need no recordings: a shaken hand's, scaled to fill a given box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.fft

from benchmarks.captures import Image
from rsdeblur import BlurPaths, Camera, Exposure, GyroLog, PsfBank
from rsdeblur.motion.paths import Capture
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.psf import tile_centres
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

NSR = 0.01
EXPOSURE = Exposure(0.05, 1 / 20)
READOUT = 0.03
SEED = 3
# Drawing a scene takes seconds per megapixel; for speed, small ones side by side will do.
SCENE = 384, 512
NOISE = 1e-3


@dataclass(frozen=True)
class Case:
    """A picture size and a PSF size.

    Parameters
    ----------
    width, height : int
        Of the picture, px.
    box : (int, int)
        Width and height of the PSFs, odd, px.
    """

    width: int
    height: int
    box: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the picture: RGB."""
        return self.height, self.width, 3

    @property
    def camera(self) -> Camera:
        """A phone's main camera."""
        return Camera(self.width, self.height, 1.1 * self.width, readout_time=READOUT)

    def log(self, bands: int, strips: int = 1) -> GyroLog:
        """Return a raw log whose PSFs on these tiles just fill the box."""
        return _log(self, bands, strips)

    def bank(self, bands: int, strips: int = 1) -> PsfBank:
        """Return the PSFs of :meth:`log`."""
        bank = psfs(self.log(bands, strips), self.camera, EXPOSURE, bands=bands, strips=strips)
        if bank.size != self.box[::-1]:
            raise AssertionError(f"the PSFs have size {bank.size}, wanted {self.box[::-1]}")
        return bank

    @property
    def sharp(self) -> Image:
        """Linear light in [0, 1]."""
        repeats = (-(-self.height // SCENE[0]), -(-self.width // SCENE[1]), 1)
        return np.tile(scene(*SCENE), repeats)[: self.height, : self.width].copy()

    @cached_property
    def blurred(self) -> Image:
        """The sharp picture blurred with the global PSF as if it repeated, and noise."""
        size = self.height, self.width
        otf = scipy.fft.rfft2(centred(self.bank(1).kernels[0, 0], size))[:, :, None]
        spectrum = scipy.fft.rfft2(self.sharp, axes=(0, 1)) * otf
        noise = np.random.default_rng(SEED).normal(scale=NOISE, size=self.shape)
        blurred: Image = (scipy.fft.irfft2(spectrum, s=size, axes=(0, 1)) + noise).astype(np.float32)
        return blurred


@cache
def _log(case: Case, bands: int, strips: int) -> GyroLog:
    log = hand_shake(0.2, seed=SEED)
    rows, cols = tile_centres(bands, case.height), tile_centres(strips, case.width)
    # A kernel is 2 (floor(reach) + 1) + 1 px; aim at the middle. Rates about x move the picture along y. No roll: it
    # would make the width of the box depend on the height of the picture.
    wanted = np.array([case.box[1] // 2 - 0.5, case.box[0] // 2 - 0.5])
    scale = np.ones(2)
    for _ in range(4):  # nearly linear in the rates
        shaken = GyroLog(log.t, log.omega * (*scale, 0.0))
        paths = BlurPaths.from_capture(Capture.from_log(shaken, case.camera, EXPOSURE), rows, cols)
        scale *= wanted / paths.extent
    return shaken


def centred(kernel: Image, size: tuple[int, ...]) -> Image:
    """Place a kernel in an array of `size` with its centre at (0, 0), wrapped around."""
    out = np.zeros(size, dtype=np.float32)
    out[: kernel.shape[0], : kernel.shape[1]] = kernel
    return np.roll(out, (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2)), axis=(0, 1))
