"""Gain and verdict against the length of the blur: ``python -m benchmarks.still [--lengths PX ...]``.

Eight Kodak pictures of 512x384 px and a real phone's shake, reduced or enlarged to a given mean length of the paths,
are deblurred with automatic strengths: with white noise, in 8 bits as JPEG, with the typical errors of a recording, and
as a phone processes them. The default lengths are those of nearly still photos. There is little to gain there, so the
question is whether the results are worse than the photos. Moments and noise are others than those that the bound of the
path error was chosen on.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from skimage.transform import rescale

from benchmarks import data
from benchmarks.captures import READOUT, SimulatedCapture, quality
from benchmarks.phone import from_phone
from benchmarks.priors import jpeg, noisy, with_errors
from benchmarks.tables import markdown
from rsdeblur import Camera, Exposure, deblur, simulate, to_linear
from rsdeblur.choices import PRIORS, VERDICTS, Prior, Verdict
from rsdeblur.motion import Capture

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
SIZE = 512, 384
DURATION = 1 / 40
# Mean length of the paths, px, and rounds in which the rates are scaled to it.
LENGTHS = 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0
ROUNDS = 3


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prior", choices=PRIORS, default="hyper-laplacian")
    parser.add_argument("--lengths", type=float, nargs="+", default=LENGTHS, metavar="PX")
    parser.add_argument("--enlarged", type=int, default=1, help="factor on the size of the pictures (1)")
    options = parser.parse_args()
    rows = []
    for length in track(options.lengths, "lengths"):
        drawn = list(captures(length, options.enlarged))
        longest = np.mean([Capture.from_log(*capture.recording).probe.lengths.max() for capture in drawn])
        results = [results_of(capture, n, options.prior) for n, capture in enumerate(drawn)]
        rows.append([f"{length:g}", f"{longest:.1f}", *(cell([each[name] for each in results]) for name in results[0])])
    columns = ["paths, px", "longest", *(f"{name}, dB" for name in results[0])]
    Console(width=250, highlight=False, markup=False).print(data.noted(markdown(columns, rows)))


def cell(results: list[tuple[float, Verdict]]) -> str:
    """Return the mean gain, in brackets the least, and the verdicts."""
    gains, verdicts = zip(*results, strict=True)
    counts = Counter(verdicts)
    judged = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
    return f"{np.mean(gains):+.2f} ({min(gains):+.2f}); {judged}"


def captures(length: float, enlarged: int) -> Iterator[SimulatedCapture]:
    """Simulate captures without noise whose paths have a mean length in px."""
    width, height = (enlarged * side for side in SIZE)
    camera = Camera(width, height, 1.1 * width, readout_time=READOUT)
    recorded = data.shake()
    for name, start in MOMENTS:
        log, exposure = recorded, Exposure(start, DURATION, recorded.epoch_ns)
        for _ in range(ROUNDS):
            found = float(Capture.from_log(log, camera, exposure).probe.lengths.mean())
            log = replace(log, omega=length / found * log.omega)
        stored = data.encoded(name)
        if enlarged > 1:
            stored = rescale(stored, enlarged, order=3, channel_axis=-1).clip(0, 1).astype(np.float32)
        pictures = simulate(to_linear(stored, "srgb"), log, camera, exposure)
        yield SimulatedCapture(name, log, camera, exposure, pictures)


def results_of(capture: SimulatedCapture, n: int, prior: Prior) -> dict[str, tuple[float, Verdict]]:
    """Return the gain in PSNR over the photo, in dB, and the verdict of the `n`-th capture in each situation."""
    grainy = noisy(capture, 45)
    situations = {
        "noise of 45 dB": grainy,
        "and JPEG 90": replace(grainy, pictures=grainy.pictures._replace(blurred=jpeg(grainy.pictures.blurred))),
        "and wrong model": with_errors(grainy),
        "phone": from_phone(capture, n + 2),
    }
    results = {}
    for name, part in situations.items():
        truth, photo = part.pictures.rolling, part.pictures.blurred
        result = deblur(photo, *part.recording, prior=prior, saturation="ignore")
        assert result.check is not None
        results[name] = quality(truth, result.image)[0] - quality(truth, photo)[0], result.check.verdict
    return results


if __name__ == "__main__":
    main()
