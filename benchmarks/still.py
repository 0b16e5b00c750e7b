"""Nearly still photos: ``python -m benchmarks.still [--prior PRIOR]``.

Eight Kodak pictures of 512x384 px and a real phone's shake, reduced or enlarged to a given mean length of the paths,
are deblurred with automatic strengths. There is little to gain, so the question is whether the results are worse than
the photos: with white noise, in 8 bits as JPEG, and as a phone processes them. Moments and noise are others than those
that the bound of the path error was chosen on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks import data
from benchmarks.captures import READOUT, SimulatedCapture, quality
from benchmarks.phone import from_phone
from benchmarks.priors import jpeg, noisy
from benchmarks.tables import markdown
from rsdeblur import Camera, Capture, Exposure, deblur, simulate
from rsdeblur.choices import PRIORS, Prior

# (Kodak picture, start in the log in s)
MOMENTS = [
    ("kodim05", 8.0),
    ("kodim19", 15.0),
    ("kodim23", 22.0),
    ("kodim13", 30.0),
    ("kodim07", 38.0),
    ("kodim01", 45.0),
    ("kodim03", 26.0),
    ("kodim20", 34.0),
]
CAMERA = Camera(512, 384, 1.1 * 512, readout_time=READOUT)
DURATION = 1 / 40
# Mean length of the paths, px, and rounds in which the rates are scaled to it.
LENGTHS = 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0
ROUNDS = 3


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prior", choices=PRIORS, default="hyper-laplacian")
    options = parser.parse_args()
    rows = []
    for length in track(LENGTHS, "lengths"):
        gains = [gains_of(capture, n, options.prior) for n, capture in enumerate(captures(length))]
        cells = (f"{np.mean(some):+.2f} ({min(some):+.2f})" for some in zip(*(g.values() for g in gains), strict=True))
        rows.append([f"{length:g}", *cells])
    columns = ["paths, px", *(f"{name}, dB" for name in gains[0])]
    Console(width=200, highlight=False, markup=False).print(markdown(columns, rows))


def captures(length: float) -> Iterator[SimulatedCapture]:
    """Simulate captures without noise whose paths have a mean length in px."""
    recorded = data.shake()
    for name, start in MOMENTS:
        log, exposure = recorded, Exposure(start, DURATION, recorded.epoch_ns)
        for _ in range(ROUNDS):
            found = float(Capture.from_log(log, CAMERA, exposure).probe.lengths.mean())
            log = replace(log, omega=length / found * log.omega)
        pictures = simulate(data.light(name), log, CAMERA, exposure)
        yield SimulatedCapture(name, log, CAMERA, exposure, pictures)


def gains_of(capture: SimulatedCapture, n: int, prior: Prior) -> dict[str, float]:
    """Return the gain in PSNR over the photo, in dB, of the `n`-th capture in each situation."""
    grainy = noisy(capture, 45)
    stored = replace(grainy, pictures=grainy.pictures._replace(blurred=jpeg(grainy.pictures.blurred)))
    gains = {}
    for name, part in {"noise of 45 dB": grainy, "and JPEG 90": stored, "phone": from_phone(capture, n + 2)}.items():
        truth, photo = part.pictures.rolling, part.pictures.blurred
        image = deblur(photo, *part.recording, prior=prior, saturation="ignore", check=False).image
        gains[name] = quality(truth, image)[0] - quality(truth, photo)[0]
    return gains


if __name__ == "__main__":
    main()
