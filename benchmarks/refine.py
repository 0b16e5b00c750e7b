"""How well `refine` corrects wrong recordings of simulated captures that a phone has processed.

``python -m benchmarks.refine [--captures N] [--kinds none,drift,...]``. Errors are root mean square distances between
the paths and the true ones, in px, each path about its mean. The constants of `refine` were chosen on the same
photographs at other moments of the log, with other seeds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.captures import DATA, require_data
from benchmarks.phone import phone_photo
from rsdeblur import Camera, Correction, Exposure, RsdeblurError, read_gyro, refine, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.transfer import to_linear
from rsdeblur.io import read_picture
from rsdeblur.motion.paths import BlurPaths, Capture

PICTURES = ("kodim01", "kodim03", "kodim05", "kodim07", "kodim13", "kodim19", "kodim20", "kodim23")
KINDS = ("none", "offset", "readout", "scale", "bias", "drift", "all")
# Mean length of the paths that are used, px.
LENGTHS = 4.0, 35.0


@dataclass(frozen=True, eq=False)
class Case:
    """A simulated picture with its true recording."""

    name: str
    picture: NDArray[np.uint8]
    true: Recording


def cases(count: int, seed: int) -> Iterator[Case]:
    """Simulate captures from photographs and a real phone's shake, at random times of its log."""
    log = read_gyro(DATA / "gyro" / "phone-210hz.txt")
    random = np.random.default_rng(seed)
    for n in range(count):
        name = PICTURES[n % len(PICTURES)]
        stored = np.asarray(read_picture(DATA / "sharp" / f"{name}.png").pixels, np.float32) / 255
        if stored.shape[0] > stored.shape[1]:
            stored = np.rot90(stored)
        height, width, _ = stored.shape
        while True:
            readout_time, duration = random.choice([0.01, 0.02, 0.03]), random.choice([1 / 30, 1 / 20, 1 / 15, 1 / 10])
            camera = Camera(width, height, width * random.uniform(0.75, 1.1), readout_time=float(readout_time))
            exposure = Exposure(random.uniform(2, 55), float(duration), log.epoch_ns)
            try:
                capture = Capture.from_log(log, camera, exposure)
            except RsdeblurError:
                continue
            if LENGTHS[0] < capture.probe.lengths.mean() < LENGTHS[1]:
                break
        light = simulate(
            to_linear(np.ascontiguousarray(stored, dtype=np.float32), "srgb"), log, camera, exposure
        ).blurred
        yield Case(f"{name} {exposure.start:.1f} s", phone_photo(light, n), Recording(log, camera, exposure))


def error(kind: str, random: np.random.Generator, recording: Recording) -> Correction:
    """Return a random error of one kind."""
    camera, duration = recording.camera, recording.exposure.duration
    sign = random.choice([-1, 1])
    if kind == "offset":
        return Correction(offset=float(sign * random.uniform(5e-3, 20e-3)))
    if kind == "readout":
        return Correction(readout=float(np.log(random.choice([0.7, 0.85, 1.2, 1.4]))))
    if kind == "scale":
        return Correction(scale=float(np.log(random.choice([0.85, 0.93, 1.07, 1.15]))))
    if kind == "bias":
        bias = random.normal(size=3)
        bias *= random.uniform(0.01, 0.03) / np.linalg.norm(bias)
        px = camera.focal_length[0] * duration
        return Correction(drift_x=float(bias[1] * px), drift_y=float(bias[0] * px), roll=float(bias[2]))
    if kind == "drift":
        turn, length = random.uniform(0, 2 * np.pi), random.uniform(3, 8) * camera.width / 640
        return Correction(drift_x=float(length * np.cos(turn)), drift_y=float(length * np.sin(turn)))
    if kind == "all":
        drift = random.uniform(-3, 3, 2) * camera.width / 640
        return Correction(
            scale=random.uniform(-0.1, 0.1),
            drift_x=float(drift[0]),
            drift_y=float(drift[1]),
            offset=float(sign * random.uniform(3e-3, 10e-3)),
            readout=random.uniform(-0.2, 0.2),
            roll=random.uniform(-0.02, 0.02),
        )
    return Correction()


def paths(recording: Recording) -> NDArray[np.float64]:
    """Return the paths at 9 x 5 places, each about its mean."""
    capture = recording.capture()
    rows, cols = (np.linspace(0, n - 1, m) for n, m in ((capture.camera.height, 9), (capture.camera.width, 5)))
    displacements = BlurPaths.from_capture(capture, rows, cols, samples=65).displacements
    return np.asarray(displacements - displacements.mean(axis=2, keepdims=True))


def distance(recording: Recording, other: Recording) -> float:
    """Return the root mean square distance of the paths, px."""
    return float(np.sqrt(np.square(paths(recording) - paths(other)).sum(axis=-1).mean()))


def main() -> None:
    """Run the benchmark and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=int, default=16)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=2026)
    options = parser.parse_args()
    require_data()
    results: dict[str, list[tuple[float, float, bool]]] = {kind: [] for kind in options.kinds.split(",")}
    for n, case in enumerate(cases(options.captures, options.seed)):
        for kind, rows in results.items():
            random = np.random.default_rng((options.seed, n, KINDS.index(kind)))
            try:
                given = case.true.corrected(error(kind, random, case.true))
                before = distance(given, case.true)
            except RsdeblurError:
                continue
            begin = time.perf_counter()
            found = refine(case.picture, given.log, given.camera, given.exposure, translation=given.translation)
            seconds = time.perf_counter() - begin
            refined = Recording(found.log, found.camera, found.exposure, found.translation)
            rows.append((before, distance(refined, case.true), found.accepted))
            note = "accepted" if found.accepted else found.reason
            print(f"{case.name}, {kind}: {before:.2f} -> {rows[-1][1]:.2f} px, {seconds:.1f} s, {note}", flush=True)
    print("\n| error | pictures | accepted | px, mean before | after | median after | worst change |")
    print("|---|---|---|---|---|---|---|")
    for kind, rows in results.items():
        given_px, left_px = [row[0] for row in rows], [row[1] for row in rows]
        accepted, worst = sum(row[2] for row in rows), max(b - a for a, b in zip(given_px, left_px, strict=True))
        means = f"{statistics.mean(given_px):.2f} | {statistics.mean(left_px):.2f} | {statistics.median(left_px):.2f}"
        print(f"| {kind} | {len(rows)} | {accepted} | {means} | {worst:+.2f} |")


if __name__ == "__main__":
    main()
