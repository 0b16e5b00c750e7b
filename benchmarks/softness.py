"""Undoing the softness of the lens with the motion: ``python -m benchmarks.softness [--captures N]``.

The captures of the other benchmarks, 512x384 px and as sharp as their pixels, are blurred by a Gaussian as well, as by
a lens, pixels and demosaicing; then white noise of 40 dB is added. They are deblurred with several values of
`softness`, the default prior and automatic strengths.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.ndimage import gaussian_filter

from benchmarks.captures import SimulatedCapture, quality, simulated
from benchmarks.priors import noisy
from benchmarks.tables import markdown
from rsdeblur import deblur
from rsdeblur.choices import Mode

# Softness of the pictures, px, and what is given, as multiples of it.
TRUE, GIVEN = (0.5, 0.75), (0.0, 0.7, 1.0, 1.3)
MODES: tuple[Mode, ...] = ("banded", "rowwise")


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=int, help="only the first N of the 14 captures")
    options = parser.parse_args()
    captures = list(simulated(options.captures, noise=0.0, enlarged=1))
    cases = [(mode, true) for mode in MODES for true in TRUE]
    rows = [
        [mode, f"{true:g}", *(f"{mean_quality(captures, mode, true, true * share):.2f}" for share in GIVEN)]
        for mode, true in track(cases, "modes")
    ]
    columns = ["mode", "softness, px", *("not given" if share == 0 else f"{share:g} times" for share in GIVEN)]
    Console(width=200, highlight=False, markup=False).print(markdown(columns, rows))


def mean_quality(captures: list[SimulatedCapture], mode: Mode, true: float, given: float) -> float:
    """Return the mean PSNR in dB of captures of a softness that are deblurred with another."""
    found = []
    for capture in captures:
        soft = gaussian_filter(capture.pictures.blurred, (true, true, 0))
        part = noisy(replace(capture, pictures=capture.pictures._replace(blurred=soft)), 40)
        image = deblur(part.pictures.blurred, *part.recording, mode=mode, softness=given, check=False).image
        found.append(quality(part.pictures.rolling, image)[0])
    return float(np.mean(found))


if __name__ == "__main__":
    main()
