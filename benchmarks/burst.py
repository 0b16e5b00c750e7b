"""Frames deblurred together against alternatives: ``python -m benchmarks.burst [--frames 2,4,8] [--markdown FILE]``.

Eight simulated bursts of a real phone's shake, exposures from 1/30 to 1/8 s, 30 ms readout. Every method is scored
against the sharp picture in the pose of its own frame: PSNR in sRGB. The alternatives use the places that rotation
gives: the average of the aligned frames, and Fourier burst accumulation of the aligned frames (Delbracio and Sapiro,
"Removing camera shake via weighted Fourier burst accumulation", IEEE Trans. Image Processing 24, 2015).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from scipy import fft, ndimage

from benchmarks.captures import DATA, READOUT, Image, quality, require_data
from benchmarks.tables import markdown, write
from rsdeblur import (
    BurstResult,
    Camera,
    Exposure,
    GyroLog,
    deblur,
    deblur_burst,
    read_gyro,
    read_picture,
    simulate_clip,
    to_linear,
)
from rsdeblur.choices import Prior
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.motion.alignment import Alignment, burst_captures
from rsdeblur.pipeline.burst_frames import Warp

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
CAMERA = Camera(512, 384, 1.1 * 512, readout_time=READOUT)
# Exposure times, s, and the time between exposures.
SHORTEST, LONGEST, PAUSE = 1 / 30, 1 / 8, 0.04
# Power of Fourier burst accumulation, and the smoothing of its weights as a share of the picture's side.
POWER, SMOOTHING = 11.0, 1 / 50
# Displacement of a near thing against the scene in the tests of robustness, px.
PARALLAX = 10


@dataclass(frozen=True, eq=False)
class Burst:
    """A simulated burst with its truth."""

    name: str
    log: GyroLog
    exposures: list[Exposure]
    frames: list[Image]
    truths: list[Image]


def burst(
    index: int,
    count: int,
    noise: float,
    *,
    change: Callable[[Image], Image] | None = None,
    reverse: bool = False,
) -> Burst:
    """Simulate a burst; frame 1 may show the scene that `change` returns, or be shaken in reverse."""
    name, start = MOMENTS[index]
    log = read_gyro(DATA / "gyro" / "phone-210hz.txt")
    sharp = to_linear((read_picture(DATA / "sharp" / f"{name}.png").pixels / 255).astype(np.float32), "srgb")
    durations = np.exp(np.random.default_rng(index).uniform(np.log(SHORTEST), np.log(LONGEST), count))
    starts = start + np.concatenate([[0.0], np.cumsum(durations[:-1] + PAUSE)])
    exposures = [Exposure(float(t), float(d), log.epoch_ns) for t, d in zip(starts, durations, strict=True)]
    during = (log.t >= exposures[1].start) & (log.t <= exposures[1].start + exposures[1].duration + READOUT)
    other = replace(log, omega=np.where(during[:, None], -1, 1) * log.omega) if reverse else log

    def seen(samples: int, noise: float) -> list[Image]:
        """Return what the frames show; `samples` of 1 is the scene at mid-exposure."""
        frames = list(simulate_clip(sharp, log, CAMERA, exposures, noise=noise, samples=samples))
        if change is not None or (reverse and samples > 1):
            scene = sharp if change is None else change(sharp)
            frames[1] = list(simulate_clip(scene, other, CAMERA, exposures, noise=noise, samples=samples))[1]
        return frames

    return Burst(f"{name} {start:g} s", log, exposures, seen(64, noise), seen(1, 0.0))


def alone(case: Burst, prior: Prior) -> list[float]:
    """Return the PSNR of each frame deblurred alone."""
    return [
        quality(truth, deblur(frame, case.log, CAMERA, exposure, prior=prior, check=False).image)[0]
        for frame, truth, exposure in zip(case.frames, case.truths, case.exposures, strict=True)
    ]


def together(case: Burst, prior: Prior, **keywords: Any) -> tuple[float, BurstResult]:
    """Return the PSNR of the frames deblurred together, and the result."""
    result = deblur_burst(case.frames, case.log, CAMERA, case.exposures, prior=prior, check=False, **keywords)
    return quality(case.truths[result.reference], result.image)[0], result


def aligned(case: Burst, reference: int) -> list[Image]:
    """Return the frames resampled to the reference; what a frame does not show is taken from the reference."""
    captures = burst_captures(case.log, CAMERA, case.exposures)
    rows, cols = np.arange(float(CAMERA.height)), np.arange(float(CAMERA.width))
    pictures = []
    for capture, frame in zip(captures, case.frames, strict=True):
        x, y = Warp.of(Alignment(capture, captures[reference])).at(rows, cols)
        light = EncodedImage.of(frame, "linear").linear(slice(None))
        moved = np.stack([ndimage.map_coordinates(part, [y, x], order=3) for part in np.moveaxis(light, -1, 0)], -1)
        seen = (x >= 0) & (x <= CAMERA.width - 1) & (y >= 0) & (y <= CAMERA.height - 1)
        pictures.append(np.where(seen[..., None], moved, case.frames[reference]).astype(np.float32))
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


def compare(count: int, noise: float, prior: Prior, bursts: int) -> list[tuple[str, ...]]:
    """Return a row for each burst: best and mean single frame, the alternatives, and the frames together."""
    rows: list[tuple[str, ...]] = []
    for index in range(bursts):
        case = burst(index, count, noise)
        single = alone(case, prior)
        score, result = together(case, prior)
        pictures, truth = aligned(case, result.reference), case.truths[result.reference]
        others = [quality(truth, method(pictures))[0] for method in (average, accumulated)]
        rows.append((case.name, *(f"{v:.2f}" for v in (max(single), float(np.mean(single)), *others, score))))
    values = np.array([[float(v) for v in row[1:]] for row in rows])
    rows.append(("mean", *(f"{v:.2f}" for v in values.mean(axis=0))))
    worst = float((values[:, -1] - values[:, 0]).min())
    rows.append(("least gain over the best single frame", "", "", "", "", f"{worst:+.2f}"))
    return rows


def robust(noise: float, prior: Prior, bursts: int) -> list[tuple[str, ...]]:
    """Return a row for each disturbance of one frame of four: the least gain over the best single frame."""

    def pasted(sharp: Image, top: int, left: int) -> Image:
        """Return the scene with a part of it repeated in the middle."""
        moved = sharp.copy()
        moved[180:340, 280:460] = sharp[top : top + 160, left : left + 180]
        return moved

    disturbances: dict[str, dict[str, Any]] = {
        "motion of one frame reversed": {"reverse": True},
        "a moving thing in one frame": {"change": partial(pasted, top=60, left=480)},
        f"{PARALLAX} px of parallax in one frame": {"change": partial(pasted, top=180, left=280 - PARALLAX)},
    }
    rows: list[tuple[str, ...]] = []
    for name, disturbance in disturbances.items():
        gains = []
        for index in range(bursts):
            case = burst(index, 4, noise, **disturbance)
            gains.append(together(case, prior)[0] - max(alone(case, prior)))
        rows.append((name, f"{min(gains):+.2f}", f"{np.mean(gains):+.2f}"))
    return rows


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", default="2,4,8", help="numbers of frames (default: 2,4,8)")
    parser.add_argument("--bursts", type=int, default=len(MOMENTS), help="only the first N of the 8 bursts")
    parser.add_argument("--prior", default="tv", help="prior of all methods that deblur (default: tv)")
    parser.add_argument("--noise", type=float, default=0.01, help="standard deviation of the noise (default: 0.01)")
    parser.add_argument("--robust", action="store_true", help="disturb one frame of four instead")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    options = parser.parse_args()
    require_data()
    if options.robust:
        heads = ("one frame of four", "least gain over the best single frame, dB", "mean gain, dB")
        text = markdown(heads, robust(options.noise, options.prior, options.bursts))
    else:
        columns = ("PSNR, dB", "best single", "mean single", "average", "accumulation", "together")
        text = "\n\n".join(
            f"{count} frames, {options.prior}, noise {options.noise:g}:\n\n"
            + markdown(columns, compare(int(count), options.noise, options.prior, options.bursts))
            for count in options.frames.split(",")
        )
    if options.markdown:
        write(options.markdown, text)
    Console(width=200, highlight=False, markup=False).print(text)


if __name__ == "__main__":
    main()
