"""Calibration of simulated clips: ``python -m benchmarks.calibrate [--clips N] [--first SEED] [--markdown FILE]``.

Each clip of 30 frames (1 s) of 480x360 or 360x480 px is filmed with random axes of the gyro (one of 24), readout
direction and time (5 to 30 ms), clock offset (within 0.3 s), focal length, exposure time (2 to 27 ms), gyro bias (0.02
rad/s) and gyro noise (0.003 rad/s). Clips of odd seeds move as a real phone that was shaken on purpose, those of even
seeds as generated shake of three strengths. The calibration starts from a guessed focal length and from no axes,
readout or offset. Each clip is calibrated with its own log, with that log mirrored, which must be named left-handed,
and with the log of another clip, which must be refused. The second row of the table has camera translation of 5 cm/s
rms in front of a scene at 3 m.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.transform import resize

from benchmarks import data
from benchmarks.data import noted
from benchmarks.tables import markdown, report
from rsdeblur import Camera, Exposure, GyroLog, Translation, hand_shake, simulate_clip
from rsdeblur.calibration import Calibration
from rsdeblur.calibration.clip import calibrate_matches
from rsdeblur.calibration.matches import ClipMatches, match_clip
from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.motion.axes import letters, mountings
from rsdeblur.types import FloatArray

FRAMES, RATE = 30, 30.0
LONG, SHORT = 480, 360
GUESSED_FOCAL = 480.0
SEARCH = (-1.0, 1.0)
SCENES = ("opensfm_berlin_01", "opensfm_berlin_01", "imagecompression_flower_foveon_rgb8")
NOISE, GYRO_NOISE, BIAS = 0.004, 0.003, 0.02
# Translation: rms velocity in m/s of waves of 0.3 to 3 Hz, and the depth of the scene in m.
VELOCITY, DEPTH = 0.05, 3.0
# Requirements: ms, and shares.
OFFSET_LIMIT, FOCAL_LIMIT, READOUT_LIMIT = 1e-3, 0.01, 0.05


@dataclass(frozen=True)
class FilmedClip:
    """A simulated clip: its matches, the log as recorded, and the true camera."""

    matches: ClipMatches
    log: GyroLog
    camera: Camera
    bias: FloatArray

    def calibrated(self, log: GyroLog) -> Calibration:
        """Return the calibration with a log, from start values that are not the truth."""
        start = Camera(self.camera.width, self.camera.height, GUESSED_FOCAL)
        return calibrate_matches(self.matches, 0, log, start, SEARCH)

    def truth(self) -> dict[str, float]:
        """Return the true values of a calibration."""
        bias = dict(zip(("bias_x", "bias_y", "bias_z"), self.bias.tolist(), strict=True))
        focal, readout = self.camera.focal_length[0], self.camera.readout_time
        return {"time_offset": self.camera.time_offset, "focal_length": focal, "readout_time": readout} | bias


def filmed(seed: int, *, moving: bool) -> FilmedClip:
    """Film a clip whose camera also moves, if `moving` is set."""
    random = np.random.default_rng(seed)
    sharp = data.pixels(SCENES[seed % len(SCENES)]).mean(axis=2) / 255
    scale = 3 * LONG / max(sharp.shape)
    sharp = resize(sharp, [round(side * scale) for side in sharp.shape], anti_aliasing=True)
    width, height = (LONG, SHORT) if random.random() < 0.6 else (SHORT, LONG)
    offset = random.uniform(-0.3, 0.3)
    camera = Camera(
        width,
        height,
        random.uniform(0.7, 1.3) * LONG,
        readout_time=random.uniform(0.005, 0.03),
        readout_direction=READOUT_DIRECTIONS[random.integers(4)],
        imu_to_camera=mountings()[random.integers(24)],
    )
    duration = min(random.choice([1 / 500, 1 / 120, 1 / 60, 1 / 30]), 0.8 / RATE)
    exposures = [Exposure(i / RATE, duration) for i in range(FRAMES)]
    span = FRAMES / RATE
    if seed % 2:
        real = data.shake()
        log = GyroLog(real.t - random.uniform(1, 40), real.omega).trimmed(-1.5, span + 1.5)
    else:
        log = hand_shake(span + 3, seed=seed, strength=random.choice([0.1, 0.3, 0.6])).shifted(-1.5)
    path = _translation(random, span) if moving else None
    frames = simulate_clip(
        sharp, log, camera, exposures, noise=NOISE, seed=seed, samples=6, translation=path, transfer="srgb"
    )
    matches = match_clip((np.round(255 * frame.clip(0, 1)).astype(np.uint8) for frame in frames), exposures, camera)
    bias = random.normal(0.0, BIAS, 3)
    noise = random.normal(0.0, GYRO_NOISE, log.omega.shape)
    print(f"clip {seed}: {len(matches.pair)} matches", file=sys.stderr)
    recorded = GyroLog(log.t - offset, log.omega + bias + noise)
    return FilmedClip(matches, recorded, replace(camera, time_offset=offset), bias)


def _translation(random: np.random.Generator, span: float) -> Translation:
    t = np.linspace(-0.1, span + 0.1, 400)
    frequency, phase = random.uniform(0.3, 3.0, (3, 6)), random.uniform(0, 2 * np.pi, (3, 6))
    waves = np.sin(2 * np.pi * frequency[..., None] * t + phase[..., None]) / (2 * np.pi * frequency[..., None])
    return Translation(t, (VELOCITY * np.sqrt(2 / 6) * waves.sum(axis=1)).T, DEPTH)


def rows(seeds: Sequence[int]) -> Iterator[list[str]]:
    """Yield the rows of the table: the scene far away, and at a small depth with a moving camera."""
    for label, moving in (("rotation", False), ("rotation and translation", True)):
        clips = [filmed(seed, moving=moving) for seed in seeds]
        results = [clip.calibrated(clip.log) for clip in clips]
        good = [(clip, result) for clip, result in zip(clips, results, strict=True) if result.accepted]
        right = [letters(clip.camera.imu_to_camera) == result.mounting for clip, result in good]
        direct = [clip.camera.readout_direction == result.camera.readout_direction for clip, result in good]
        mirrored = [_mirrored_is_named(clip) for clip in clips]
        strange = [
            clip.calibrated(other.log).accepted for clip, other in zip(clips, (*clips[1:], clips[0]), strict=True)
        ]
        errors, scores = _errors(good)
        cells = [label, f"{len(good)} of {len(clips)}", f"{sum(right)} of {len(good)}", f"{sum(direct)} of {len(good)}"]
        limits = (
            ("time_offset", OFFSET_LIMIT, 1e3),
            ("focal_length", FOCAL_LIMIT, 100),
            ("readout_time", READOUT_LIMIT, 100),
        )
        for name, limit, unit in limits:
            e = np.abs(errors[name])
            cells.append(f"{unit * np.median(e):.2g} / {unit * e.max():.2g} ({np.mean(e < limit):.0%})")
        cells.append(", ".join(f"{np.sqrt(np.mean(z**2)):.1f}" for z in scores.values()))
        cells += [f"{sum(mirrored)} of {len(mirrored)}", f"{sum(strange)} of {len(strange)}"]
        yield cells


def _mirrored_is_named(clip: FilmedClip) -> bool:
    """Return whether the clip's log with left-handed axes is refused for them."""
    mirrored = GyroLog(clip.log.t, clip.log.omega * (1, 1, -1))
    result = clip.calibrated(mirrored)
    return not result.accepted and "left-handed" in result.reason


def _errors(good: Sequence[tuple[FilmedClip, Calibration]]) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return errors, s or shares of the truth, and errors in standard deviations of the determined values."""
    errors: dict[str, list[float]] = {}
    scores: dict[str, list[float]] = {}
    for clip, result in good:
        for name, truth in clip.truth().items():
            value, sd = result.values[name].value, result.values[name].sd
            scale = abs(truth) if name in ("focal_length", "readout_time") else 1.0
            errors.setdefault(name, []).append((value - truth) / scale)
            if sd is not None:
                scores.setdefault(name, []).append((value - truth) / sd)
    return {k: np.array(v) for k, v in errors.items()}, {k: np.array(v) for k, v in scores.items()}


COLUMNS = (
    "motion", "accepted", "axes right", "direction right", "offset error, ms", "focal length error, %",
    "readout error, %", "error / deviation", "mirrored log named", "other log accepted",
)  # fmt: skip


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=12, help="number of clips for each motion")
    parser.add_argument("--first", type=int, default=100, help="seed of the first clip")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    table = markdown(COLUMNS, rows(range(options.first, options.first + options.clips)))
    report(noted(table), options.markdown)


if __name__ == "__main__":
    main()
