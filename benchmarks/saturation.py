"""Streaks around lamps, with ``saturation="ignore"`` and ``"always"``: ``python -m benchmarks.saturation``.

The scene is a dim bookshelf with eight lamps, points and discs of up to 25 times full scale. It is blurred in linear
light, gets noise of 50 dB, is clipped at 1 and stored in 8 bits of sRGB, or with ``--jpeg Q`` as a JPEG of that
quality. *Streaks* are the mean squared error in sRGB, times 10^4, within one PSF of lamps; lamps and 2 px around them
are left out. The PSNR is that of the rest, without the border of the frame. All strengths are automatic. No recordings
are needed.

``--daylight N`` measures the cost where there are no lamps: the first N simulated captures, 512x384 px, two and four
times overexposed, with noise of 40 dB, in banded mode. The PSNR is that of the clipped picture.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from scipy import ndimage

from benchmarks.captures import BORDER, READOUT, SimulatedCapture, quality, simulated
from benchmarks.data import Image, noted
from benchmarks.priors import noisy
from benchmarks.tables import markdown, report
from rsdeblur import Camera, Exposure, deblur, simulate
from rsdeblur.choices import MODES, SATURATIONS, Prior
from rsdeblur.image.transfer import from_linear, to_linear
from rsdeblur.simulation import Simulation
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

# Each lamp: row and column as shares of height and width; radius in px, 0 for a point; light in full scales.
LAMPS = (
    (0.20, 0.15, 0.0, 60),
    (0.30, 0.50, 2.5, 10),
    (0.25, 0.85, 0.0, 200),
    (0.55, 0.30, 1.5, 30),
    (0.60, 0.70, 4.0, 4),
    (0.80, 0.20, 3.0, 20),
    (0.85, 0.55, 0.0, 100),
    (0.75, 0.90, 2.0, 6),
)
DIM, NOISE = 0.12, 0.003
# Standard deviation by which the lens spreads a point, px.
LENS = 0.7
LAMP, AROUND = 0.5, 2
SEEDS = (3, 5, 7)
GAINS = np.float32(2), np.float32(4)
PRIORS: tuple[Prior, ...] = ("wiener", "tv")


def night(height: int, width: int) -> Image:
    """Return the scene in linear light."""
    light = DIM * scene(height, width).astype(np.float64)
    y, x = np.mgrid[:height, :width]
    for down, across, radius, value in LAMPS:
        disc = np.clip(radius + 0.5 - np.hypot(y - down * height, x - across * width), 0, 1)
        light += value * ndimage.gaussian_filter(disc, LENS)[..., None]
    return np.asarray(light, dtype=np.float32)


def capture(seed: int) -> SimulatedCapture:
    """Simulate a capture of the scene; its pictures are not clipped."""
    recording = (
        hand_shake(0.2, strength=1.5, seed=seed),
        Camera(256, 192, 280.0, readout_time=READOUT),
        Exposure(0.05, 1 / 20),
    )
    return SimulatedCapture(f"night {seed}", *recording, simulate(night(240, 304), *recording, noise=NOISE))


def recorded(light: Image, jpeg: int | None = None) -> NDArray[np.uint8]:
    """Return `light` as stored in 8 bits, after JPEG compression if a quality is given."""
    pixels = np.rint(255 * from_linear(light.clip(0, 1), "srgb")).astype(np.uint8)
    if jpeg is not None:
        packed = BytesIO()
        Pillow.fromarray(pixels).save(packed, "JPEG", quality=jpeg)
        pixels = np.asarray(Pillow.open(packed))
    return pixels


def measures(truth: Image, image: Image, reach: int) -> tuple[float, float]:
    """Return the streaks of a picture in sRGB, and the PSNR of the rest, dB."""
    error = np.square(image.clip(0, 1) - from_linear(truth.clip(0, 1), "srgb")).mean(axis=-1)
    lamps = ndimage.binary_dilation(truth.max(axis=-1) > LAMP, iterations=AROUND)
    near = ndimage.binary_dilation(lamps, iterations=reach)
    rest = ~near
    rest[:BORDER] = rest[-BORDER:] = rest[:, :BORDER] = rest[:, -BORDER:] = False
    return 1e4 * float(error[near & ~lamps].mean()), -10 * float(np.log10(error[rest].mean()))


def overexposed(count: int, jpeg: int | None) -> Iterator[list[str]]:
    """Yield the rows of the daylight table."""
    for taken in simulated(count, noise=0.0, enlarged=1):
        for gain in GAINS:
            brighter = Simulation(*(gain * picture for picture in taken.pictures))
            bright = noisy(replace(taken, pictures=brighter), 40)
            pixels = recorded(bright.pictures.blurred, jpeg)
            line = [f"{taken.name}, {gain:g} times", f"{100 * (pixels == 255).any(axis=2).mean():.0f}"]
            for prior in PRIORS:
                for saturation in SATURATIONS:
                    result = deblur(pixels, *taken.recording, prior=prior, transfer="srgb", saturation=saturation)
                    line.append(f"{quality(bright.pictures.rolling, to_linear(result.image, 'srgb'))[0]:.2f}")
            yield line


def rows(jpeg: int | None, seeds: tuple[int, ...] = SEEDS) -> Iterator[list[str]]:
    """Yield the rows of the table of lamps."""
    for seed in seeds:
        taken = capture(seed)
        pixels = recorded(taken.pictures.blurred, jpeg)
        for mode in MODES:
            for prior in PRIORS:
                settings: dict[str, Any] = {"mode": mode, "prior": prior, "transfer": "srgb"}
                plain, careful = (
                    deblur(pixels, *taken.recording, **settings, saturation=s) for s in ("ignore", "always")
                )
                reach = max(plain.psfs.size)
                (a, outside), (b, then) = (measures(taken.pictures.rolling, r.image, reach) for r in (plain, careful))
                yield [
                    f"{taken.name}, {mode}, {prior}",
                    *(f"{a:.0f}", f"{b:.0f}", f"{a / b:.1f}", f"{outside:.1f}", f"{then:.1f}"),
                ]


COLUMNS = (
    "capture, mode, prior", "streaks, ignore", "always", "factor", "PSNR of the rest, ignore", "always",
)  # fmt: skip
DAYLIGHT = (
    "capture, overexposed",
    "clipped, %",
    *(f"{prior}, {saturation}" for prior in PRIORS for saturation in SATURATIONS),
)


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jpeg", type=int, metavar="Q", help="store as JPEG of this quality")
    parser.add_argument("--daylight", type=int, metavar="N", help="overexposed captures without lamps instead")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    if options.daylight is None:
        table = markdown(COLUMNS, rows(options.jpeg))
    else:
        table = markdown(DAYLIGHT, overexposed(options.daylight, options.jpeg))
    report(table if options.daylight is None else noted(table), options.markdown)


if __name__ == "__main__":
    main()
