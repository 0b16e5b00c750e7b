"""Noise, JPEG and 8 bits: ``python -m benchmarks.hard [--captures N] [--markdown FILE]``.

Captures of 512x384 px in 8 bits of sRGB: with white noise of 20 to 50 dB in light, and at 40 dB as JPEG of quality 50
to 95. Every mode and prior deblurs them with automatic strengths. The table shows the gain in PSNR over the input, in
dB: the mean over the captures, and in brackets the least. A gain below zero means that deblurring did harm.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.captures import SimulatedCapture, quality, simulated
from benchmarks.priors import noisy
from benchmarks.saturation import recorded
from benchmarks.tables import markdown, write
from rsdeblur import deblur
from rsdeblur.choices import MODES, PRIORS, Mode
from rsdeblur.image.transfer import to_linear


class Situation(NamedTuple):
    """Noise in dB (infinite: no noise) and quality of the JPEG (None: a lossless file)."""

    noise: float
    jpeg: int | None

    def __str__(self) -> str:
        """Return the name in the table."""
        noise = f"{self.noise:g} dB" if np.isfinite(self.noise) else "no noise"
        return noise if self.jpeg is None else f"{noise}, JPEG {self.jpeg}"


SITUATIONS = (
    *(Situation(noise, None) for noise in (20, 30, 40, 50, np.inf)),
    *(Situation(40, jpeg) for jpeg in (50, 75, 90, 95)),
)


def gains(capture: SimulatedCapture, situation: Situation, mode: Mode) -> list[float]:
    """Return the gain of every prior, dB, on a capture without noise of its own."""
    noisy_capture = noisy(capture, situation.noise)
    pixels = recorded(noisy_capture.pictures.blurred, situation.jpeg)
    images = [np.divide(pixels, 255, dtype=np.float32)]
    images += [
        deblur(pixels, *noisy_capture.recording, mode=mode, prior=prior, transfer="srgb", saturation="ignore").image
        for prior in PRIORS
    ]
    before, *after = (quality(noisy_capture.pictures.rolling, to_linear(image, "srgb"))[0] for image in images)
    return [score - before for score in after]


def rows(captures: Sequence[SimulatedCapture]) -> Iterator[list[str]]:
    """Yield the rows of the table."""
    for situation in SITUATIONS:
        for mode in MODES:
            all_gains = np.array([gains(capture, situation, mode) for capture in captures])
            yield [str(situation), mode, *(f"{prior.mean():+.1f} ({prior.min():+.1f})" for prior in all_gains.T)]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=int, default=6, help="the first N of the 14 captures")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    captures = list(simulated(options.captures, noise=0.0, enlarged=1))
    table = markdown(("input", "mode", *PRIORS), rows(captures))
    if options.markdown:
        write(options.markdown, table)
    print(table)


if __name__ == "__main__":
    main()
