"""Captures for the benchmarks, simulated with ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from skimage.transform import rescale

from benchmarks import data
from benchmarks.data import Image
from rsdeblur import Camera, Exposure, GyroLog, Translation, simulate
from rsdeblur.image.transfer import from_linear, to_linear
from rsdeblur.simulation import Simulation
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

# 40 dB below full scale.
NOISE = 0.01
# Width of the border that PSNR and SSIM leave out, px.
BORDER = 24
READOUT = 0.03
# Enlargement of runs that only show that a benchmark works: 128x96 px.
QUICK = 1 / 4


@dataclass(frozen=True)
class SimulatedCapture:
    """A simulated capture with its ground truth."""

    name: str
    log: GyroLog
    camera: Camera
    exposure: Exposure
    pictures: Simulation
    translation: Translation | None = None
    """What the recording says of it; the simulated camera turns only."""

    @property
    def recording(self) -> tuple[GyroLog, Camera, Exposure]:
        """Log, camera and exposure: the arguments of `deblur` after the picture."""
        return self.log, self.camera, self.exposure


# (Kodak picture, start in the log in s, exposure in s). The moments range from nearly still to shaken hard.
MOMENTS = [
    ("kodim05", 3.0, 1 / 15),
    ("kodim19", 10.0, 1 / 30),
    ("kodim23", 17.0, 1 / 60),
    ("kodim13", 25.0, 1 / 15),
    ("kodim07", 33.0, 1 / 30),
    ("kodim01", 40.0, 1 / 15),
    ("kodim03", 21.0, 1 / 60),
    ("kodim20", 29.0, 1 / 60),
    ("kodim01", 6.0, 1 / 30),
    ("kodim05", 36.5, 1 / 60),
    ("kodim13", 44.0, 1 / 30),
    ("kodim23", 50.0, 1 / 15),
    ("kodim07", 13.0, 1 / 12),
    ("kodim03", 47.0, 1 / 12),
]


# Eighty more, which the last thresholds of the check were chosen on as well; and twenty which none was chosen on.
OTHER_MOMENTS = [
    *((MOMENTS[n % 8][0], 1.7 + 2.6 * n, 1 / (15, 20, 30, 60)[(n + n // 8) % 4]) for n in range(20)),
    *((MOMENTS[(3 * n + 1) % 8][0], 0.6 + 2.7 * n, 1 / (12, 15, 24, 40)[(n + n // 4) % 4]) for n in range(20)),
    *((MOMENTS[(5 * n + 2) % 8][0], 1.1 + 2.7 * n, 1 / (15, 25, 40, 60)[(n + n // 4) % 4]) for n in range(20)),
    *((MOMENTS[(7 * n + 3) % 8][0], 2.3 + 2.6 * n, 1 / (15, 20, 30, 60)[(n + n // 4) % 4]) for n in range(20)),
]
NEW_MOMENTS = [(MOMENTS[(n + n // 8) % 8][0], 0.9 + 2.65 * n, 1 / (15, 20, 30, 60)[n % 4]) for n in range(20)]


def simulated(
    count: int | None = None,
    *,
    noise: float = NOISE,
    enlarged: float = 2,
    moments: Sequence[tuple[str, float, float]] = MOMENTS,
) -> Iterator[SimulatedCapture]:
    """Simulate captures from Kodak pictures and a real phone's shake, 1024x768 px, or 512x384 with `enlarged=1`."""
    log = data.shake()
    camera = Camera(1024, 768, 1.1 * 1024, readout_time=READOUT).scaled(enlarged / 2)
    for picture, start, duration in moments[:count]:
        shown = data.encoded(picture)
        if enlarged != 1:
            shown = rescale(shown, enlarged, order=3, channel_axis=-1).clip(0, 1).astype(np.float32)
        sharp = to_linear(shown, "srgb")
        exposure = Exposure(start, duration, log.epoch_ns)
        name = f"{data.named(picture)} {start:g} s 1/{round(1 / duration)}"
        yield SimulatedCapture(name, log, camera, exposure, simulate(sharp, log, camera, exposure, noise=noise))


def synthetic(*, noise: float = NOISE) -> SimulatedCapture:
    """Simulate a small capture that needs no recordings."""
    log, camera, exposure = (
        hand_shake(0.2, seed=3),
        Camera(256, 192, 280.0, readout_time=READOUT),
        Exposure(0.05, 1 / 30),
    )
    return SimulatedCapture(
        "synthetic", log, camera, exposure, simulate(scene(240, 304), *(log, camera, exposure), noise=noise)
    )


def quality(truth: Image, image: Image) -> tuple[float, float]:
    """Return PSNR (dB) and SSIM of pictures in linear light, compared in sRGB without the border."""
    inside = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    a, b = (from_linear(x.clip(0, 1), "srgb")[inside] for x in (truth, image))
    psnr = peak_signal_noise_ratio(a, b, data_range=1.0)
    return float(psnr), float(structural_similarity(a, b, data_range=1.0, channel_axis=-1))
