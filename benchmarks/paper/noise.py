"""Figures 8 and 9: noise of the gyroscope; and the error budget of the other inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import fftconvolve

from benchmarks import data
from benchmarks.captures import NOISE, SimulatedCapture, quality
from benchmarks.paper.figure import Figure, lines
from rsdeblur import Camera, Exposure, GyroLog, deblur, psfs, simulate
from rsdeblur.choices import MODES, Mode

LEVELS = (0.0, 0.007, 0.02, 0.035, 0.05, 0.065, 0.08, 0.1)
REPETITIONS = 10
# Levels for captures in all modes: fewer, because rowwise takes seconds.
ROLLING_LEVELS = (0.0, 0.007, 0.02, 0.05, 0.1)
TYPICAL = 0.007  # rad/s rms of a phone's gyroscope, as they state
START, DURATION = 14.0, 1 / 15
NSR = 0.01
CAMERA = Camera(640, 448, 704.0, readout_time=0.03)
# Captures that are shaken at least moderately: picture, start in the log (s), exposure (s).
CHOSEN = (("kodim05", 3.0, 1 / 15), ("kodim07", 33.0, 1 / 30), ("kodim01", 40.0, 1 / 15))

# Size of each error: unit, steps.
ERRORS: dict[str, tuple[str, tuple[float, ...]]] = {
    "offset": ("ms", (1.0, 2.0, 5.0)),
    "readout": ("%", (5.0, 10.0, 20.0)),
    "focal length": ("%", (2.0, 5.0, 10.0)),
    "bias": ("rad/s", (0.01, 0.02, 0.05)),
}


def figures(quick: bool) -> Iterator[Figure]:
    """Yield figures 8 and 9, the same measurement for captures, and the error budget."""
    repetitions = 2 if quick else REPETITIONS
    yield global_blur(repetitions)
    captures = [shaken(*chosen) for chosen in (CHOSEN[:1] if quick else CHOSEN)]
    yield rolling_shutter(captures, max(1, repetitions // 5))
    yield budget(captures)


def shaken(picture: str, start: float, duration: float) -> SimulatedCapture:
    """Simulate a capture under a rolling shutter."""
    log = data.shake()
    exposure = Exposure(start, duration, log.epoch_ns)
    pictures = simulate(data.light(picture), log, CAMERA, exposure, noise=NOISE)
    return SimulatedCapture(picture, log, CAMERA, exposure, pictures)


def noisy(log: GyroLog, deviation: float, seed: int) -> GyroLog:
    """Add white Gaussian noise to every rate."""
    noise = np.random.default_rng(seed).normal(0.0, deviation, log.omega.shape)
    return GyroLog(log.t, log.omega + noise, log.epoch_ns)


def global_blur(repetitions: int) -> Figure:
    """Return figures 8 and 9: one PSF from the true log blurs, one from a noisy log deblurs."""
    log = data.shake().trimmed(START - 1, START + 1)
    camera, exposure = Camera(768, 512, 845.0), Exposure(START, DURATION, log.epoch_ns)
    sharp = (data.pixels("kodim05") / 255).mean(axis=2)
    kernel = psfs(log, camera, exposure, mode="global", motion="small-angle").kernels[0, 0]
    padded = np.pad(sharp, [(n // 2, n // 2) for n in kernel.shape], mode="wrap")
    blurred = fftconvolve(padded, kernel, mode="valid") + np.random.default_rng(0).normal(0, NOISE, sharp.shape)

    def error(used: GyroLog) -> float:
        result = deblur(blurred, used, camera, exposure, mode="global", motion="small-angle", nsr=NSR, prior="wiener")
        return float(np.square(result.image - sharp)[24:-24, 24:-24].mean())

    def curve(deviation: Callable[[float], float]) -> list[float]:
        runs = [[error(noisy(log, deviation(level), seed)) for seed in range(repetitions)] for level in LEVELS]
        return [float(np.mean(run)) for run in runs]

    curves = {"as variance (rad/s)^2": curve(lambda level: level**0.5), "as deviation rad/s": curve(float)}
    baseline = float(np.square(blurred - sharp)[24:-24, 24:-24].mean())
    variance, deviation = (np.array(c) / c[0] for c in curves.values())
    at, typical = LEVELS.index(0.05), LEVELS.index(TYPICAL)
    holds = deviation[at] < 1.1 < max(deviation[-1], variance[at])
    return Figure(
        "fig8-9",
        "Figures 8 and 9: noise of the gyroscope, one PSF",
        f"{data.named('kodim05')} blurred with the PSF of a {data.REAL} log ({kernel.shape[1]}x{kernel.shape[0]} px), "
        f"image noise of 40 dB; deblurred with PSFs from the log with Gaussian noise, mean of {repetitions} draws. "
        f"MSE on [0, 1]; the blurred picture has {baseline:.4f}. Their text calls the axis both variance and rad/s, so "
        "both are shown.",
        f"{'Holds' if holds else 'Holds in part'}: read as a deviation, 0.05 rad/s raises the error by "
        f"{100 * (deviation[at] - 1):.0f} % and 0.1 rad/s by {100 * (deviation[-1] - 1):.0f} %; read as a variance, "
        f"0.05 raises it by {100 * (variance[at] - 1):.0f} %; a phone's {TYPICAL} rad/s by "
        f"{100 * (deviation[typical] - 1):.1f} %.",
        ("noise", *curves),
        list(zip(LEVELS, *curves.values(), strict=True)),
        lines(LEVELS, curves, "noise of the gyroscope", "MSE", ylim=(0, None)),
    )


def mean_quality(
    captures: Sequence[SimulatedCapture],
    mode: Mode,
    spoil: Callable[[SimulatedCapture], tuple[GyroLog, Camera, Exposure]],
) -> float:
    """Return the mean PSNR (dB) over captures that are deblurred with a wrong description."""
    scores = [
        quality(c.pictures.rolling, deblur(c.pictures.blurred, *spoil(c), mode=mode, nsr=NSR, prior="wiener").image)[0]
        for c in captures
    ]
    return float(np.mean(scores))


def disturbed(deviation: float, seed: int, capture: SimulatedCapture) -> tuple[GyroLog, Camera, Exposure]:
    """Return the capture's description with a noisy log."""
    log, camera, exposure = capture.recording
    return noisy(log, deviation, seed), camera, exposure


def rolling_shutter(captures: Sequence[SimulatedCapture], repetitions: int) -> Figure:
    """Return the same figure for rolling-shutter captures, in all modes."""
    curves: dict[str, list[float]] = {}
    for mode in MODES:
        curves[mode] = [
            float(
                np.mean([mean_quality(captures, mode, partial(disturbed, level, seed)) for seed in range(repetitions)])
            )
            for level in ROLLING_LEVELS
        ]
    loss = {mode: curve[0] - curve[ROLLING_LEVELS.index(0.05)] for mode, curve in curves.items()}
    ahead = {mode: curves[mode][-1] - curves["global"][-1] for mode in MODES[1:]}
    return Figure(
        "fig8-9-rolling",
        "Noise of the gyroscope under a rolling shutter",
        f"{len(captures)} simulated captures of {CAMERA.width}x{CAMERA.height} px (readout 30 ms, 40 dB), mean of "
        f"{repetitions} draws. PSNR, dB.",
        "New here: at 0.05 rad/s "
        + ", ".join(f"{mode} loses {db:.2f} dB" for mode, db in loss.items())
        + "; at 0.1 rad/s, compared with global, "
        + " and ".join(f"{mode} is still {db:+.1f} dB" for mode, db in ahead.items())
        + ".",
        ("noise (rad/s)", *curves),
        list(zip(ROLLING_LEVELS, *curves.values(), strict=True)),
        lines(ROLLING_LEVELS, curves, "noise of the gyroscope (rad/s)", "PSNR (dB)"),
    )


def spoilt(what: str, by: float, capture: SimulatedCapture) -> tuple[GyroLog, Camera, Exposure]:
    """Return the capture's description with one number wrong."""
    log, camera, exposure = capture.recording
    if what == "offset":
        return log, replace(camera, time_offset=camera.time_offset + 1e-3 * by), exposure
    if what == "readout":
        return log, replace(camera, readout_time=camera.readout_time * (1 + by / 100)), exposure
    if what == "focal length":
        fx, fy = camera.focal_length
        return log, replace(camera, focal_length=(fx * (1 + by / 100), fy * (1 + by / 100))), exposure
    return log.minus_bias([by, -by, by]), camera, exposure


def budget(captures: Sequence[SimulatedCapture]) -> Figure:
    """Return the figure of decibels lost for each error, both signs averaged."""
    best: dict[Mode, float] = {mode: mean_quality(captures, mode, lambda c: c.recording) for mode in MODES}
    rows: list[tuple[str | float, ...]] = []
    for what, (unit, steps) in ERRORS.items():
        for step in steps:
            lost = [
                best[mode] - np.mean([mean_quality(captures, mode, partial(spoilt, what, s)) for s in (-step, step)])
                for mode in MODES
            ]
            rows.append((f"{what} ({unit})", step, *map(float, lost)))

    def draw(canvas: Any) -> None:
        for axes, (what, (unit, steps)) in zip(canvas.subplots(1, len(ERRORS)), ERRORS.items(), strict=True):
            for k, mode in enumerate(MODES):
                axes.plot(steps, [row[2 + k] for row in rows if row[0] == f"{what} ({unit})"], "o-", label=mode)
            axes.set(xlabel=f"{what} ({unit})", ylabel="dB lost" if what == "offset" else "")
            axes.grid(alpha=0.3)
        axes.legend()

    worst = {str(row[0]): (float(row[1]), *map(float, row[2:])) for row in rows}
    return Figure(
        "budget",
        "Error budget",
        f"Decibels lost on the same {len(captures)} captures when one input has the given error, both signs averaged; "
        f"without error {', '.join(f'{mode} {value:.2f} dB' for mode, value in best.items())}.",
        "New here: losses of global, banded and rowwise at the largest step: "
        + "; ".join(
            f"{name.split(' (')[0]} off by {step:g} {ERRORS[name.split(' (')[0]][0]}: "
            + ", ".join(f"{db:.2f}" for db in lost)
            for name, (step, *lost) in worst.items()
        )
        + " dB.",
        ("error", "by", *(f"{mode} (dB)" for mode in MODES)),
        rows,
        draw,
    )
