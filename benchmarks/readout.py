"""What a wrong guess of the readout time costs: ``python -m benchmarks.readout [--seed N] [--records FILE]``.

Photographs are exposed 1/60 to 1/15 s at random moments of a phone's shake, with a readout of 30 to 35 ms, which the
camera gives as 20 or 10 ms, both +- 10 ms. The table has how much of the PSNR that the guess costs comes back, how many
results are more than 2 dB below the one with the right readout time and nevertheless `good`, and how many of those
within 1 dB are `good`. Each capture is appended to --records as soon as it is measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import data
from benchmarks.data import noted
from benchmarks.phone import phone_photo
from benchmarks.refine import PICTURES, aligned_psnr, landscape, usable
from benchmarks.tables import append, markdown, recorded
from rsdeblur import Camera, Exposure, deblur, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.transfer import from_linear

# Times that are given, s, and their standard deviation.
GIVEN, SD = (0.02, 0.01), 0.01
# Noise of linear light in pictures that no phone has processed, in turn.
NOISES = 0.001, 0.003, 0.006
# dB below the right one from which a result should not be good, and up to which it should.
FAR, NEAR = 2.0, 1.0


@dataclass(frozen=True)
class Row:
    """PSNR (dB) and verdict of a capture with the right readout time, a guess of it, and that guess refined."""

    kind: str
    capture: int
    given: float
    right: tuple[float, str]
    guess: tuple[float, str]
    refined: tuple[float, str]


def moment(random: np.random.Generator, shape: Sequence[int]) -> Recording:
    """Return a recording of a picture at a random moment whose blur can be judged."""
    height, width, *_ = shape
    while True:
        focal_length, readout_time = width * random.uniform(0.75, 1.1), random.uniform(0.03, 0.035)
        exposure = Exposure(random.uniform(2, 55), float(random.choice([1 / 60, 1 / 30, 1 / 20, 1 / 15])))
        exposure = replace(exposure, epoch_ns=data.shake().epoch_ns)
        recording = Recording(data.shake(), Camera(width, height, focal_length, readout_time=readout_time), exposure)
        if usable(recording):
            return recording


def measured(kind: str, n: int, random: np.random.Generator) -> list[Row]:
    """Return the rows of a capture: one for each time that is given."""
    scene = landscape(PICTURES[n % len(PICTURES)])
    true = moment(random, scene.shape)
    simulation = simulate(scene, true.log, true.camera, true.exposure)
    sharp = from_linear(simulation.rolling.clip(0, 1), "srgb")
    if kind == "phone":
        photo = phone_photo(simulation.blurred, n)
    else:
        noise = np.random.default_rng(n).normal(0, NOISES[n % len(NOISES)], simulation.blurred.shape)
        light = (simulation.blurred + noise).clip(0, 1).astype(np.float32)
        photo = np.round(255 * from_linear(light, "srgb")).astype(np.uint8)

    def result(camera: Camera, *, refine: bool = False) -> tuple[float, str]:
        found = deblur(photo, true.log, camera, true.exposure, refine=refine)
        assert found.check is not None
        return aligned_psnr(sharp, found.image), found.check.verdict

    right, rows = result(true.camera), []
    for time in GIVEN:
        guess = replace(true.camera, readout_time=time, readout_sd=SD)
        rows.append(Row(kind, n, time, right, result(guess), result(guess, refine=True)))
    return rows


def table(rows: Sequence[Row]) -> str:
    """Return the table of all rows."""
    lines = []
    for kind, given in dict.fromkeys((row.kind, row.given) for row in rows):
        group = [row for row in rows if (row.kind, row.given) == (kind, given)]
        lost = sum(row.right[0] - row.guess[0] for row in group)
        left = sum(row.right[0] - row.refined[0] for row in group)
        below = [(row.right[0] - row.refined[0], row.refined[1] == "good") for row in group]
        near = [good for dB, good in below if dB <= NEAR]
        far = [good for dB, good in below if dB > FAR]
        lines.append(
            (
                f"{kind}, {1e3 * given:.0f} ms",
                f"{len(group)}",
                f"{lost / len(group):.1f}",
                f"{1 - left / lost:.0%}",
                f"{sum(far)} of {len(far)}",
                f"{sum(near)} of {len(near)}",
                f"{sum(row.right[1] == 'good' for row in group)}",
            )
        )
    columns = ("given", "captures", "dB lost", "back", "good, 2 dB below", "good within 1 dB", "right ones good")
    return markdown(columns, lines)


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=24)
    parser.add_argument("--seed", type=int, default=59)
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    options = parser.parse_args()
    rows = [Row(**record) for record in recorded(options.records)]
    for kind in ("phone", "little noise"):
        for n in range(options.captures):
            if any((row.kind, row.capture) == (kind, n) for row in rows):
                continue
            for row in measured(kind, n, np.random.default_rng((options.seed, n))):
                rows.append(row)
                append(options.records, asdict(row))
    print(noted(table(rows)))


if __name__ == "__main__":
    main()
