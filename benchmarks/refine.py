"""How well `refine` corrects wrong recordings of simulated captures that a phone has processed.

``python -m benchmarks.refine [--captures N] [--right N] [--records FILE]`` prints a table and writes
docs/benchmarks/refine.md. Each row is appended to --records as soon as it is measured; rows that the file has are not
measured again. The constants of `refine` were chosen on the same photographs at other moments of the log, with other
seeds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import data
from benchmarks.captures import BORDER
from benchmarks.data import Image, noted, pages
from benchmarks.phone import processed
from benchmarks.tables import append, markdown, recorded, write
from rsdeblur import Camera, Correction, Exposure, RsdeblurError, deblur, refine, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.regions import with_factors
from rsdeblur.image.transfer import from_linear
from rsdeblur.motion.axes import rotations
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.simulation import Simulation

PICTURES = ("kodim01", "kodim03", "kodim05", "kodim07", "kodim13", "kodim19", "kodim20", "kodim23")
KINDS = ("none", "offset", "readout", "scale", "bias", "drift", "all", "axes", "depths")
# Mean length of the paths that are used, px.
LENGTHS = 4.0, 35.0
# Softness of the pictures that are aligned, px, and the steps that this takes.
SOFT, STEPS = 2.0, 5
# Softness of the border between two depths, and the distance of the places of the true map, px.
BORDER_SOFTNESS, MAP_STEP = 40.0, 16

INTRODUCTION = """\
# Refinement

How well [`refine`](../api.md#refinement) corrects recordings that are wrong by a known amount. Made by

```sh
python -m benchmarks.refine --records FILE
```

Captures are Kodak pictures of 768x512 px under a real phone's shake at random moments (seed {seed}), exposures of 1/30
to 1/10 s, readouts of 10 to 30 ms, mean blur of 4 to 35 px, processed as by a phone: mosaic, demosaicing, denoising,
sharpening, tone curve, JPEG. The constants of `refine` were chosen at other moments of the same log.

- **px**: root mean square distance of the paths from the true ones, as recorded and as refined; each path about its
  mean.
- **dB lost, left**: how much the PSNR in sRGB of `deblur` as recorded, and as refined, is below that with the true
  recording; default options. A wrong clock or readout time also bends the sharp picture a little, which is no
  blur, so pictures are aligned with the truth first, by a quadratic polynomial of their coordinates (12 numbers).
- **Recovered**: the share of the lost dB that refinement brings back. Refused corrections bring back nothing.
- **Worst**: the largest loss of one capture against its result as recorded, dB.

The table says how many captures were measured; means of few captures vary widely.

Errors are random: offsets of 5 to 20 ms, readout times x 0.7 to x 1.4, focal lengths +-7 or 15 %, a bias of the
gyroscope of 0.01 to 0.03 rad/s, an even translation of 3.6 to 9.6 px, and smaller ones of all kinds together. Wrong
axes of the gyro (one of the other 23 mountings) no correction can undo: they should be refused. *Depths* are two
translations that the recording lacks: one side of the picture moves by 2.4 to 4.8 px, the other 2 to 4 times as far,
with a soft border between them; the true recording has the map of depths.

The constants of `refine` do not come from these captures, but the table was looked at while they were chosen. With
`--seed 5151`, no right recording of 30 is corrected, and 92 % (offset), 75 % (readout), 49 % (scale), 49 % (bias), 89 %
(drift), 81 % (all) and 67 % (depths) are recovered, of 15 captures each, and none of two depths loses. Of 160 other
right recordings (`--right 40 --kinds none`, seeds 3131, 4242, 5252 and 6262), one is corrected, with a loss of 0.73 dB.

A bias matters little in such short exposures, and most corrections of it are refused: of 0.03 rad/s in every capture,
which costs 0.24 dB on average, 28 % (seed 2026) and 40 % (seed 5151) were recovered without a loss, before light
streaks counted.

[Wrong axes](axes.md) has more recordings with wrong axes.
"""


@dataclass(frozen=True, eq=False)
class Case:
    """A capture: the scene in linear light, the true recording, and what the noise depends on."""

    name: str
    scene: Image
    true: Recording
    number: int

    @cached_property
    def simulation(self) -> Simulation:
        """The blurred and the sharp picture, linear light."""
        return simulate(self.scene, self.true.log, self.true.camera, self.true.exposure)

    @cached_property
    def picture(self) -> NDArray[np.uint8]:
        """The picture that the phone stores."""
        random = np.random.default_rng(self.number)
        return processed(self.simulation.blurred, random, noise=(0.004, 0.01, 0.02)[self.number % 3])


@dataclass(frozen=True, eq=False)
class Depths(Case):
    """A capture of things at two depths, which drift differently; the border between them is soft."""

    drift: Correction
    near: float
    """How much further the nearer things drift."""
    share: Image
    """Share of the nearer things, shape (H, W, 1)."""

    @classmethod
    def of(cls, case: Case, random: np.random.Generator) -> Depths:
        """Return a capture with random drifts and a random border through its middle."""
        (height, width, _), turn = case.scene.shape, random.uniform(0, 2 * np.pi)
        length, near = random.uniform(2, 4) * width / 640, random.uniform(2, 4)
        drift = Correction(drift_x=float(length * np.cos(turn)), drift_y=float(length * np.sin(turn)))
        side = random.uniform(0, 2 * np.pi)
        y, x = np.mgrid[:height, :width]
        beyond = (x - width / 2) * np.cos(side) + (y - height / 2) * np.sin(side)
        share = (1 / (1 + np.exp(-beyond / BORDER_SOFTNESS))).astype(np.float32)[..., None]
        return cls(case.name, case.scene, case.true, case.number, drift, near, share)

    @cached_property
    def simulation(self) -> Simulation:
        """The pictures of both depths, blended."""
        drifts = [
            replace(self.drift, **{name: size * getattr(self.drift, name) for name in ("drift_x", "drift_y")})
            for size in (1.0, self.near)
        ]
        moved = [self.true.corrected(drift) for drift in drifts]
        far, near = (
            simulate(self.scene, each.log, each.camera, each.exposure, translation=each.translation) for each in moved
        )
        return Simulation(*(a + self.share * (b - a) for a, b in zip(far, near, strict=True)))

    @property
    def known(self) -> Recording:
        """The recording with the true map of depths."""
        factors = 1 + (self.near - 1) * self.share[::MAP_STEP, ::MAP_STEP, 0].astype(np.float64)
        centres = [(np.arange(count) + 0.5) / count for count in factors.shape]
        return with_factors(self.true, self.drift, factors, (centres[0], centres[1]))


@dataclass(frozen=True)
class Row:
    """What refinement did to one capture with one error: errors of the paths in px, PSNR in dB."""

    seed: int
    capture: int
    kind: str
    accepted: bool
    seconds: float
    given_px: float
    refined_px: float
    given: float
    refined: float
    true: float


def cases(count: int, seed: int) -> Iterator[Case]:
    """Simulate captures from photographs and a real phone's shake, at random times of its log."""
    log = data.shake()
    random = np.random.default_rng(seed)
    for n in range(count):
        name = PICTURES[n % len(PICTURES)]
        scene = landscape(name)
        height, width, _ = scene.shape
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
        yield Case(f"{data.named(name)} {exposure.start:.1f} s", scene, Recording(log, camera, exposure), n)


def landscape(name: str) -> Image:
    """Return a picture in linear light, wider than tall."""
    light = data.light(name)
    return np.ascontiguousarray(np.rot90(light)) if light.shape[0] > light.shape[1] else light


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


def mounted(random: np.random.Generator, recording: Recording) -> Recording:
    """Return a recording with another mounting of the gyro."""
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    camera = recording.camera
    return replace(recording, camera=replace(camera, imu_to_camera=random.choice(turns) @ camera.imu_to_camera))


def paths(recording: Recording) -> NDArray[np.float64]:
    """Return the paths at 9 x 5 places, each about its mean."""
    capture = recording.capture()
    rows, cols = (np.linspace(0, n - 1, m) for n, m in ((capture.camera.height, 9), (capture.camera.width, 5)))
    displacements = BlurPaths.from_capture(capture, rows, cols, samples=65).displacements
    return np.asarray(displacements - displacements.mean(axis=2, keepdims=True))


def distance(recording: Recording, other: Recording) -> float:
    """Return the root mean square distance of the paths, px."""
    return float(np.sqrt(np.square(paths(recording) - paths(other)).sum(axis=-1).mean()))


def aligned_psnr(truth: Image, image: Image) -> float:
    """Return the PSNR (dB) of a picture in sRGB, without the border, aligned with the truth."""
    y, x = np.indices(truth.shape[:2], dtype=np.float64)
    u, v = (2 * axis / axis.max() - 1 for axis in (x, y))
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    soft, softer = (ndimage.gaussian_filter(each.mean(axis=2), SOFT) for each in (truth, image))
    slopes = np.gradient(softer)
    inside = np.s_[..., BORDER:-BORDER, BORDER:-BORDER]
    numbers = np.zeros((2, len(basis)))
    for _ in range(STEPS):
        places = np.stack([y, x]) + np.tensordot(numbers, basis, 1)
        jacobian = np.concatenate([ndimage.map_coordinates(slope, places, order=1) * basis for slope in slopes])
        residual = soft - ndimage.map_coordinates(softer, places, order=3)
        columns = jacobian[inside].reshape(len(jacobian), -1)
        numbers += np.linalg.lstsq(columns @ columns.T, columns @ residual[inside].ravel())[0].reshape(numbers.shape)
    places = np.stack([y, x]) + np.tensordot(numbers, basis, 1)
    shown = np.stack([ndimage.map_coordinates(part, places, order=3) for part in np.moveaxis(image, -1, 0)], axis=-1)
    crop = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return float(peak_signal_noise_ratio(truth[crop], shown[crop].clip(0, 1), data_range=1.0))


@lru_cache(maxsize=32)
def psnr(case: Case, recording: Recording) -> float:
    """Return the PSNR (dB) of a capture deblurred with a recording."""
    parts = recording.log, recording.camera, recording.exposure
    result = deblur(case.picture, *parts, translation=recording.translation, saturation="ignore", check=False)
    return aligned_psnr(from_linear(case.simulation.rolling.clip(0, 1), "srgb"), result.image)


def measured(case: Case, kind: str, seed: int) -> Row | None:
    """Return what refinement does to a capture with an error; None where the log does not describe that recording."""
    random = np.random.default_rng((seed, case.number, KINDS.index(kind)))
    true = case.true
    if kind == "depths":
        case = Depths.of(case, random)
        true = case.known
    try:
        given = mounted(random, case.true) if kind == "axes" else case.true.corrected(error(kind, random, case.true))
        given_px = distance(given, true)
    except RsdeblurError:
        return None
    begin = time.process_time()
    found = refine(case.picture, given.log, given.camera, given.exposure, translation=given.translation)
    seconds = time.process_time() - begin
    refined = Recording(found.log, found.camera, found.exposure, found.translation) if found.accepted else given
    return Row(
        seed,
        case.number,
        kind,
        found.accepted,
        seconds,
        given_px,
        distance(refined, true),
        given=psnr(case, given),
        refined=psnr(case, refined),
        true=psnr(case, true),
    )


def table(rows: list[Row]) -> str:
    """Return the means of each kind of error."""
    lines = []
    for kind in KINDS:
        group = [row for row in rows if row.kind == kind]
        if not group:
            continue
        means = {
            name: float(np.mean([getattr(row, name) for row in group]))
            for name in Row.__annotations__
            if name != "kind"
        }
        lost = means["true"] - means["given"]
        recovered = "-" if kind in ("none", "axes") else f"{(means['refined'] - means['given']) / lost:.0%}"
        worst = max(row.given - row.refined for row in group)
        lines.append(
            (
                "none: the recording is right" if kind == "none" else kind,
                f"{len(group)}",
                f"{sum(row.accepted for row in group)}",
                f"{means['given_px']:.2f} -> {means['refined_px']:.2f}",
                f"{lost:.2f}",
                f"{means['true'] - means['refined']:.2f}",
                recovered,
                f"{max(worst, 0.0):.2f}",
            )
        )
    return markdown(("error", "captures", "accepted", "px", "dB lost", "left", "recovered", "worst"), lines)


def main() -> None:
    """Run the benchmark, print its table and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=15, help="captures with every kind of error")
    parser.add_argument("--right", type=int, default=30, help="captures whose recording is right")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of errors to measure, separated by commas")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    parser.add_argument("--page", type=Path, default=pages() / "refine.md")
    options = parser.parse_args()
    rows = {(row.capture, row.kind): row for row in (Row(**each) for each in recorded(options.records))}
    for n, case in enumerate(cases(max(options.captures, options.right), options.seed)):
        for kind in options.kinds.split(","):
            if (n, kind) in rows or n >= (options.right if kind == "none" else options.captures):
                continue
            row = measured(case, kind, options.seed)
            if row is None:
                continue
            rows[n, kind] = row
            print(f"{case.name}, {kind}: {row}", flush=True)
            append(options.records, asdict(row))
    text = table(list(rows.values()))
    print(noted(text))
    write(options.page, noted(INTRODUCTION.format(seed=options.seed) + "\n" + text))


if __name__ == "__main__":
    main()
