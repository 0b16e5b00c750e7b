"""Frames deblurred together against alternatives: ``python -m benchmarks.burst [--quick] [--records FILE]``.

Eight simulated bursts of a real phone's shake: Kodak pictures of half size, 256x192 px, exposures from 1/30 to 1/8 s,
30 ms readout. Every method is scored against the sharp picture in the pose of its own frame: PSNR in sRGB. Bursts of 2
and 4 frames are the first ones of those of 8.

The alternatives use the places that rotation gives: the average of the aligned frames, and Fourier burst accumulation
of the aligned frames (Delbracio and Sapiro, "Removing camera shake via weighted Fourier burst accumulation", IEEE
Trans. Image Processing 24, 2015).

Each row is appended to --records as soon as it is measured; rows that the file has are not measured again.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft, ndimage

from benchmarks import data
from benchmarks.captures import READOUT, quality
from benchmarks.data import Image, noted
from benchmarks.priors import jpeg, with_recording_errors
from benchmarks.tables import append, markdown, recorded, report
from rsdeblur import Camera, Exposure, GyroLog, Translation, deblur, deblur_burst, simulate_clip
from rsdeblur.choices import Auto, Mode, Prior
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.motion.paths import burst_captures, places

# (Kodak picture, start in the log in s)
MOMENTS = [
    ("kodim05", 3.0),
    ("kodim19", 10.0),
    ("kodim23", 17.0),
    ("kodim13", 25.0),
    ("kodim07", 33.0),
    ("kodim01", 40.2),
    ("kodim03", 21.0),
    ("kodim20", 29.0),
]
# The camera of benchmarks.captures at a quarter of its size.
CAMERA = Camera(1024, 768, 1.1 * 1024, readout_time=READOUT).scaled(1 / 4)
MOST_FRAMES = 8
# Exposure times, s, and the time between exposures.
SHORTEST, LONGEST, PAUSE = 1 / 30, 1 / 8, 0.04
# Exposure times of the pair of a long and a short frame, s. Shot noise of equal brightness grows with the root of the
# ratio of the times.
PAIR = 1 / 8, 1 / 125
# Warps per row: most paths are shorter than 30 px.
WARPS = 32
# Power of Fourier burst accumulation, and the smoothing of its weights as a share of the picture's side.
POWER, SMOOTHING = 11.0, 1 / 50
# Displacement of a near thing against the scene in the tests of robustness, px: 10 px at the pictures' own size.
PARALLAX = 5
# Frame that is disturbed in these tests.
DISTURBED = 1
# A disc before the scene in all frames: its radius, px; how it moves during the burst, px; and how far the scene itself
# moves where the camera does, which the log does not say, px. The disc is then at a third of the scene's distance.
RADIUS, TRAVEL, SLIDE = 45, (40.0, 15.0), 5.0
# Bursts with such a disc.
MOVING, NEAR = "a thing that moves in all frames", "a near thing in all frames, before a camera that moves sideways"


@dataclass(frozen=True)
class Case:
    """A burst and what is done with it.

    Parameters
    ----------
    kind : {"frames", "pair", MOVING, NEAR} or a key of `CHANGES`
        Frames of one scene, a long and a short one, four frames with a disc before the scene, or four frames of which
        one is disturbed.
    burst : int
        Index into `MOMENTS`.
    frames : int
        Number of frames.
    decibels : float
        Noise of a frame; in a pair, that of the long one.
    mode, prior : str
        Mode and prior of all methods that deblur; the mode "auto" of bursts is "banded" for a single frame.
    wrong : bool
        Whether camera and log have the errors of :func:`benchmarks.priors.with_errors`, and the frames are JPEG.
    """

    kind: str
    burst: int
    frames: int
    decibels: float
    mode: Mode | Auto = "banded"
    prior: Prior = "wiener"
    wrong: bool = False

    @property
    def options(self) -> dict[str, Any]:
        """Options of :func:`rsdeblur.deblur_burst`."""
        return {"mode": self.mode, "prior": self.prior, "saturation": "ignore", "check": False}

    @property
    def single(self) -> dict[str, Any]:
        """Options of :func:`rsdeblur.deblur`."""
        return self.options | {"mode": "banded" if self.mode == "auto" else self.mode}


@dataclass(frozen=True, eq=False)
class Burst:
    """Frames of one scene with their truths."""

    exposures: tuple[Exposure, ...]
    frames: tuple[Image, ...]
    truths: tuple[Image, ...]


def moved_part(top: int, left: int) -> Callable[[Image], Image]:
    """Return the change of a scene whose middle shows another part of it."""

    def change(sharp: Image) -> Image:
        changed = sharp.copy()
        # An upright picture is narrower than `left`.
        changed[90:170, 140:230] = np.roll(sharp, (-top, -left), axis=(0, 1))[:80, :90]
        return changed

    return change


# Disturbances by name; None reverses the motion.
CHANGES: dict[str, Callable[[Image], Image] | None] = {
    "motion of one frame reversed": None,
    "a moving thing in one frame": moved_part(30, 240),
    f"{PARALLAX} px of parallax in one frame": moved_part(90, 140 - PARALLAX),
}


@cache
def recording(wrong: bool) -> tuple[GyroLog, Camera]:
    """Return the log and the camera that the methods are given."""
    return with_recording_errors(data.shake(), CAMERA) if wrong else (data.shake(), CAMERA)


@cache
def sharp(name: str) -> Image:
    """Return a picture of half size in linear light."""
    light = data.light(name)
    height, width, channels = light.shape
    half: Image = light.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))
    return half


@cache
def simulated(index: int, pair: bool = False) -> Burst:
    """Simulate a whole burst, or a pair, without noise."""
    name, start = MOMENTS[index]
    drawn = np.exp(np.random.default_rng(index).uniform(np.log(SHORTEST), np.log(LONGEST), MOST_FRAMES))
    durations = np.array(PAIR) if pair else drawn
    starts = start + np.concatenate([[0.0], np.cumsum(durations[:-1] + PAUSE)])
    exposures = [Exposure(float(t), float(d), data.shake().epoch_ns) for t, d in zip(starts, durations, strict=True)]
    return filmed(sharp(name), exposures)


def filmed(scene: Image, exposures: Sequence[Exposure]) -> Burst:
    """Simulate the frames of a scene, and their truths."""
    blurred, truths = (tuple(simulate_clip(scene, data.shake(), CAMERA, exposures, samples=n)) for n in (WARPS, 1))
    return Burst(tuple(exposures), blurred, truths)


@cache
def layered(index: int, kind: str) -> Burst:
    """Simulate four frames of a scene behind a disc that shows another part of it."""
    exposures, scene = simulated(index).exposures[:4], sharp(MOMENTS[index][0])
    height, width, _ = scene.shape
    down, across = np.mgrid[:height, :width]
    disc = (np.hypot(down - height / 2, across - 0.55 * width) < RADIUS).astype(np.float32)[..., None]
    thing = np.concatenate([np.roll(scene, (-60, -70), axis=(0, 1)) * disc, disc], axis=-1)
    opens, closes = exposures[0].start, exposures[-1].start + exposures[-1].duration + READOUT
    # A thing at rest before a camera that moves the other way is a thing that moves.
    way = (-TRAVEL[0], -TRAVEL[1], 0.0) if kind == MOVING else (SLIDE, 0.0, 0.0)
    # A little longer than the burst, which both ends must cover.
    spare, places = 0.2 * (closes - opens), np.outer([-0.2, 1.2], way) / CAMERA.focal_length[0]
    moving = Translation(np.array([opens - spare, closes + spare]), places, depth=1.0, epoch_ns=exposures[0].epoch_ns)
    motions = (None, moving) if kind == MOVING else (moving, replace(moving, depth=1 / 3))

    def seen(moments: Sequence[Exposure]) -> Iterator[Image]:
        """Yield what the middles of exposures show."""
        clips = [
            simulate_clip(picture, data.shake(), CAMERA, moments, samples=1, translation=motion)
            for picture, motion in zip((scene, thing), motions, strict=True)
        ]
        for far, near in zip(*clips, strict=True):
            yield near[..., :-1] + (1 - near[..., -1:]) * far

    # At each moment, the thing hides what is behind it; the mean of products is not the product of means.
    lengths = [(each, each.duration / WARPS) for each in exposures]
    frames = seen([Exposure(e.start + k * length, length, e.epoch_ns) for e, length in lengths for k in range(WARPS)])
    blurred = tuple(np.mean(list(islice(frames, WARPS)), axis=0) for _ in exposures)
    return Burst(tuple(exposures), blurred, tuple(seen(exposures)))


@cache
def disturbed(index: int, kind: str) -> tuple[Image, Image]:
    """Return the disturbed frame of a burst without noise, and its truth."""
    burst, log, change = simulated(index), data.shake(), CHANGES[kind]
    own, scene = burst.exposures[DISTURBED], sharp(MOMENTS[index][0])
    during = (log.t >= own.start) & (log.t <= own.start + own.duration + READOUT)
    if change is None:
        log = replace(log, omega=np.where(during[:, None], -1, 1) * log.omega)
    else:
        scene = change(scene)
    # The scene's pose depends on the first and on the last exposure.
    exposures = [own, burst.exposures[0], burst.exposures[-1]]
    frame, truth = (next(simulate_clip(scene, log, CAMERA, exposures, samples=n)) for n in (WARPS, 1))
    return frame, burst.truths[DISTURBED] if change is None else truth


def burst_of(case: Case) -> Burst:
    """Return the frames of a case, with noise."""
    pair = case.kind == "pair"
    clean = layered(case.burst, case.kind) if case.kind in (MOVING, NEAR) else simulated(case.burst, pair)
    frames, truths = list(clean.frames[: case.frames]), list(clean.truths[: case.frames])
    if case.kind in CHANGES:
        frames[DISTURBED], truths[DISTURBED] = disturbed(case.burst, case.kind)
    for n, frame in enumerate(frames):
        noise = 10 ** (-case.decibels / 20) * (PAIR[0] / PAIR[n] if pair else 1.0) ** 0.5
        white: Image = np.random.default_rng([case.burst, n]).normal(0.0, noise, frame.shape).astype(np.float32)
        frames[n] = jpeg(frame + white) if case.wrong else frame + white
    return Burst(clean.exposures[: case.frames], tuple(frames), tuple(truths))


def aligned(burst: Burst, log: GyroLog, camera: Camera, reference: int) -> list[Image]:
    """Return the frames resampled to the reference; what a frame does not show is taken from the reference."""
    captures = burst_captures(log, camera, burst.exposures)
    rows, cols = np.arange(float(CAMERA.height)), np.arange(float(CAMERA.width))
    pictures = []
    for capture, frame in zip(captures, burst.frames, strict=True):
        shown = places(capture, captures[reference], np.stack(np.meshgrid(cols, rows), axis=-1))
        x, y = np.moveaxis(shown.astype(np.float32), -1, 0)
        light = EncodedImage.of(frame, "linear").linear(slice(None))
        moved = np.stack([ndimage.map_coordinates(part, [y, x], order=3) for part in np.moveaxis(light, -1, 0)], -1)
        seen = (x >= 0) & (x <= CAMERA.width - 1) & (y >= 0) & (y <= CAMERA.height - 1)
        pictures.append(np.where(seen[..., None], moved, burst.frames[reference]).astype(np.float32))
    return pictures


def average(pictures: Sequence[Image]) -> Image:
    """Return the mean of aligned frames."""
    mean: Image = np.mean(pictures, axis=0)
    return mean


def accumulated(pictures: Sequence[Image]) -> Image:
    """Return the Fourier burst accumulation of aligned frames."""
    spectra = [fft.rfft2(picture, axes=(0, 1)) for picture in pictures]
    sides = [SMOOTHING * n for n in pictures[0].shape[:2]]
    weights = np.stack([ndimage.gaussian_filter(np.abs(s).mean(axis=2), sides, mode="wrap") ** POWER for s in spectra])
    weights /= weights.sum(axis=0)
    total = sum(w[..., None] * s for w, s in zip(weights, spectra, strict=True))
    result: Image = fft.irfft2(total, s=pictures[0].shape[:2], axes=(0, 1)).astype(np.float32)
    return result


@cache
def alone(case: Case, index: int) -> float:
    """Return the PSNR of one frame deblurred alone; it is the same in bursts of all sizes."""
    if case.kind == "frames" and case.frames < MOST_FRAMES:
        return alone(replace(case, frames=MOST_FRAMES), index)
    burst = burst_of(case)
    result = deblur(burst.frames[index], *recording(case.wrong), burst.exposures[index], **case.single)
    return quality(burst.truths[index], result.image)[0]


def singles(case: Case) -> list[float]:
    """Return the PSNR of each frame deblurred alone; frames that are not disturbed are deblurred once for all kinds."""
    plain = replace(case, kind="frames") if case.kind in CHANGES else case
    return [alone(case if n == DISTURBED else plain, n) for n in range(case.frames)]


def measure(case: Case) -> dict[str, float]:
    """Return the PSNR of all methods: best and mean single frame, the alternatives, and the frames together."""
    burst, single = burst_of(case), singles(case)
    log, camera = recording(case.wrong)
    result = deblur_burst(burst.frames, log, camera, burst.exposures, **case.options)
    truth = burst.truths[result.reference]
    pictures = aligned(burst, log, camera, result.reference)
    return {
        "best single": max(single),
        "mean single": float(np.mean(single)),
        "average": quality(truth, average(pictures))[0],
        "accumulation": quality(truth, accumulated(pictures))[0],
        "together": quality(truth, result.image)[0],
    }


def cases(*, quick: bool) -> Iterator[Case]:
    """Yield the cases of all tables."""
    four, pair = Case("frames", 0, 4, 40), Case("pair", 0, 2, 40)
    kinds = [*(replace(four, frames=count) for count in (4, 8)), pair]
    kinds += [*(replace(four, kind=kind) for kind in (*CHANGES, MOVING, NEAR)), replace(four, frames=2)]
    kinds.append(replace(four, mode="rowwise"))
    if not quick:
        kinds += [replace(four, frames=count, decibels=35) for count in (4, 2, 8)]
        default = replace(four, mode="auto", prior="hyper-laplacian")
        kinds += [replace(default, frames=count, decibels=noise) for noise in (40, 35) for count in (2, 4, 8)]
        kinds += [replace(default, kind=kind) for kind in (*CHANGES, MOVING, NEAR)]
        defaults = (default, replace(default, kind="pair", frames=2))
        kinds += [defaults[1], *(replace(case, wrong=True) for case in defaults)]
    for kind in kinds:
        for burst in range(2 if quick else len(MOMENTS)):
            yield replace(kind, burst=burst)


def table(rows: dict[Case, dict[str, float]]) -> str:
    """Return the means over the bursts and, as the last column, the least gain over the best single frame."""
    methods = list(next(iter(rows.values())))
    groups: dict[Case, list[dict[str, float]]] = {}
    for case, scores in rows.items():
        groups.setdefault(replace(case, burst=0), []).append(scores)
    lines = []
    for case, scored in groups.items():
        means = {method: np.mean([scores[method] for scores in scored]) for method in methods}
        gains = [scores["together"] - scores["best single"] for scores in scored]
        name = {"frames": f"{case.frames} frames", "pair": "a long and a short frame"}.get(case.kind, case.kind)
        gain = (f"{np.mean(gains):+.2f}", f"{min(gains):+.2f}")
        method = f"{case.mode}, {case.prior}" + ", wrong model" * case.wrong
        lines.append((f"{name}, {case.decibels:g} dB", method, *(f"{mean:.2f}" for mean in means.values()), *gain))
    return markdown(("PSNR, dB", "mode, prior", *methods, "gain", "least gain"), lines)


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two bursts with the Wiener filter")
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    rows: dict[Case, dict[str, float]] = {Case(**each["case"]): each["psnr"] for each in recorded(options.records)}
    for case in cases(quick=options.quick):
        if case not in rows:
            rows[case] = measure(case)
            scores = ", ".join(f"{method} {value:.2f}" for method, value in rows[case].items())
            name = data.named(MOMENTS[case.burst][0])
            print(f"{name}, {case.frames} frames, {case.kind}, {case.mode}, {case.prior}: {scores} dB", flush=True)
            append(options.records, {"case": asdict(case), "psnr": rows[case]})
    report(noted(table(rows)), options.markdown)


if __name__ == "__main__":
    main()
