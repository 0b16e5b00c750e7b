"""Pictures, PSFs and bursts of the speed benchmarks, without recordings: a hand's shake, scaled to fill a given box."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from PIL import Image as Pillow

from benchmarks.data import Image
from rsdeblur import Camera, Exposure, GyroLog, PsfBank, simulate_clip
from rsdeblur.motion import BlurPaths
from rsdeblur.motion.paths import Capture
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.psf import tile_centres
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

NSR = 0.01
EXPOSURE = Exposure(0.05, 1 / 20)
READOUT = 0.03
SEED = 3
# Drawing a scene takes seconds per megapixel, so a small scene is repeated side by side.
SCENE = 384, 512
NOISE = 1e-3
# Frames of a burst: exposure times and the time from one exposure to the next, s.
DURATION, STEP = 1 / 30, 0.1

Burst = tuple[list[NDArray[np.uint8]], GyroLog, Camera, list[Exposure]]


@dataclass(frozen=True)
class Case:
    """A picture size and a PSF size.

    Parameters
    ----------
    width, height : int
        Size of the picture, px.
    box : (int, int)
        Width and height of the PSFs, odd, px.
    """

    width: int
    height: int
    box: tuple[int, int]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the RGB picture."""
        return self.height, self.width, 3

    @property
    def camera(self) -> Camera:
        """Camera like the main camera of a phone."""
        return Camera(self.width, self.height, 1.1 * self.width, readout_time=READOUT)

    def log(self, bands: int, strips: int = 1) -> GyroLog:
        """Return a raw log whose PSFs on these tiles just fill the box."""
        return _log(self, bands, strips)

    def bank(self, bands: int, strips: int = 1) -> PsfBank:
        """Return the drawn PSFs of :meth:`log`, without the paths: other libraries take only kernels."""
        bank = psfs(self.log(bands, strips), self.camera, EXPOSURE, bands=bands, strips=strips)
        if bank.size != self.box[::-1]:
            raise AssertionError(f"the PSFs have size {bank.size}, expected {self.box[::-1]}")
        return replace(bank, displacements=None)

    @property
    def sharp(self) -> Image:
        """Sharp picture in linear light, [0, 1]."""
        repeats = (-(-self.height // SCENE[0]), -(-self.width // SCENE[1]), 1)
        return np.tile(scene(*SCENE), repeats)[: self.height, : self.width].copy()

    @cached_property
    def blurred(self) -> Image:
        """Sharp picture, blurred with the global PSF as if it repeated, with noise."""
        size = self.height, self.width
        otf = scipy.fft.rfft2(centred(self.bank(1).kernels[0, 0], size))[:, :, None]
        spectrum = scipy.fft.rfft2(self.sharp, axes=(0, 1)) * otf
        noise = np.random.default_rng(SEED).normal(scale=NOISE, size=self.shape)
        blurred: Image = (scipy.fft.irfft2(spectrum, s=size, axes=(0, 1)) + noise).astype(np.float32)
        return blurred


def size(text: str) -> tuple[int, int]:
    """Parse a size such as 2048x1536."""
    width, height = text.lower().split("x")
    return int(width), int(height)


def burst_of(megapixels: int, count: int, *, strength: float = 0.3) -> Burst:
    """Simulate frames of 8 bits; a camera has the aspect ratio 4 : 3, see :func:`enlarged_burst`."""
    width = 4 * round((megapixels * 1e6 * 4 / 3) ** 0.5 / 16) * 4
    return enlarged_burst(Camera(width, width * 3 // 4, 1.1 * width, readout_time=READOUT), count, strength=strength)


def enlarged_burst(camera: Camera, count: int, *, strength: float) -> Burst:
    """Simulate frames of 8 bits at a quarter of their size, and enlarge them; the blur is that of the full size.

    They are enlarged smoothly: equal pixels beside each other would show the sensor, not the scene, and so misfit.
    """
    log = hand_shake(STEP * (count + 3), strength=strength, seed=3)
    exposures = [Exposure(STEP * (n + 1), DURATION) for n in range(count)]
    small = camera.scaled(1 / 4)
    sharp = scene(small.height + 40, small.width + 40)
    frames = []
    for frame in simulate_clip(sharp, log, small, exposures, noise=0.005, transfer="srgb"):
        stored = (255 * frame.clip(0, 1)).astype(np.uint8)
        frames.append(
            np.asarray(Pillow.fromarray(stored).resize((camera.width, camera.height), Pillow.Resampling.BICUBIC))
        )
    return frames, log, camera, exposures


@cache
def _log(case: Case, bands: int, strips: int) -> GyroLog:
    log = hand_shake(0.2, seed=SEED)
    rows, cols = tile_centres(bands, case.height), tile_centres(strips, case.width)
    # A kernel has 2 (floor(reach) + 1) + 1 px; aim at the middle of that step. Rates about x move the picture along y.
    # There is no roll, which would make the width of the box depend on the height of the picture.
    target = np.array([case.box[1] // 2 - 0.5, case.box[0] // 2 - 0.5])
    scale = np.ones(2)
    for _ in range(4):  # nearly linear in the rates
        shaken = GyroLog(log.t, log.omega * (*scale, 0.0))
        paths = BlurPaths.from_capture(Capture.from_log(shaken, case.camera, EXPOSURE), rows, cols)
        scale *= target / paths.extent
    return shaken


def centred(kernel: Image, size: tuple[int, ...]) -> Image:
    """Return an array of `size` that contains a kernel with its centre at (0, 0), wrapped around."""
    out = np.zeros(size, dtype=np.float32)
    out[: kernel.shape[0], : kernel.shape[1]] = kernel
    return np.roll(out, (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2)), axis=(0, 1))
