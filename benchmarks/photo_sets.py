"""Calibration from sets of simulated photos: ``python -m benchmarks.photo_sets [--sets N] [--first SEED] [--jobs N]``.

Each set has five photos of 768x512 px of different scenes, processed as by a phone. Drawn at random for each set: the
axes of the gyro (one of 24), the direction and time of the readout (10, 20 or 30 ms), the focal length (0.75 to 1.1
times the width), the clock offset (within 12 ms); for each photo the moment, and the exposure time, so that the blur is
4 to 35 px long. In the first row a real phone was shaken on purpose; in the second a hand shakes as generated, and the
scene shifts during each exposure by up to 15 % of the blur and 1 px more. The calibration starts from no axes, from
20 ms top-down, no offset, and a focal length wrong by a factor of 0.74 to 1.35. Each set is calibrated three times:
with its log, with its log mirrored, and with the log at other moments; the last two must not be accepted.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import data
from benchmarks.data import noted
from benchmarks.phone import phone_photo
from benchmarks.refine import LENGTHS, PICTURES, landscape
from benchmarks.tables import markdown, report
from rsdeblur import (
    Camera,
    Exposure,
    GyroLog,
    PhotoCalibration,
    RsdeblurError,
    Translation,
    calibrate_photos,
    hand_shake,
    simulate,
)
from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.estimate.correction import Recording
from rsdeblur.motion.axes import letters, rotations
from rsdeblur.types import FloatArray

PHOTOS, WIDTH, HEIGHT = 5, 768, 512
# Moments that are tried for one photo; the last one is taken in any case.
TRIES = 60
MOTIONS = {"shaken on purpose": False, "hand, and the camera moves": True}
VALUES = "time_offset", "focal_length", "readout_time"


@dataclass(frozen=True, eq=False)
class PhotoSet:
    """Photos with their log as recorded, the true camera, and the start values."""

    photos: list[NDArray[np.uint8]]
    exposures: list[Exposure]
    log: GyroLog
    camera: Camera
    start: Camera

    def calibrated(self, log: GyroLog) -> PhotoCalibration:
        """Return the calibration with a log."""
        return calibrate_photos(self.photos, self.exposures, log, self.start)


@dataclass(frozen=True)
class Row:
    """What came of one set: whether it was accepted and right, its errors and the deviations, as reported."""

    accepted: bool
    mounted: bool
    directed: bool
    direction: bool
    errors: dict[str, tuple[float, float]]
    mirrored: bool
    other: bool


def taken(seed: int, *, moving: bool) -> PhotoSet:
    """Take a set of photos, with a camera that also moves if `moving` is set."""
    random = np.random.default_rng((seed, moving))
    strength = float(random.choice([0.15, 0.3, 0.6]))
    log = hand_shake(60, seed=seed, strength=strength) if moving else data.shake()
    camera = Camera(
        WIDTH,
        HEIGHT,
        WIDTH * random.uniform(0.75, 1.1),
        readout_time=float(random.choice([0.01, 0.02, 0.03])),
        readout_direction=READOUT_DIRECTIONS[random.integers(4)],
        imu_to_camera=rotations()[random.integers(24)],
    )
    photos, exposures = [], []
    for number, name in enumerate(random.permutation(PICTURES)[:PHOTOS]):
        exposure, length = _exposed(random, log, camera)
        translation = None
        if moving:
            turn = random.uniform(0, 2 * np.pi)
            px = random.uniform(0, 0.15) * length + random.uniform(0, 1)
            translation = Translation.drift((px * np.cos(turn), px * np.sin(turn)), camera, exposure)
        blurred = simulate(landscape(name), log, camera, exposure, translation=translation).blurred
        photos.append(phone_photo(blurred, 10 * seed + number))
        exposures.append(exposure)
    offset, zoom = random.uniform(-12e-3, 12e-3), np.exp(random.uniform(-0.3, 0.3))
    start = Camera(WIDTH, HEIGHT, zoom * camera.focal_length[0], readout_time=0.02)
    return PhotoSet(photos, exposures, log.shifted(-offset), replace(camera, time_offset=offset), start)


def _exposed(random: np.random.Generator, log: GyroLog, camera: Camera) -> tuple[Exposure, float]:
    """Return a random exposure and the mean length of its blur, px."""
    for _ in range(TRIES):
        duration = float(random.choice([1 / 30, 1 / 20, 1 / 15, 1 / 10, 1 / 8]))
        exposure = Exposure(random.uniform(2, 55), duration, log.epoch_ns)
        try:
            length = float(Recording(log, camera, exposure).capture().probe.lengths.mean())
        except RsdeblurError:
            continue
        if LENGTHS[0] < length < LENGTHS[1]:
            break
    return exposure, length


def measured(seed: int, *, moving: bool) -> Row:
    """Return what comes of a set."""
    photos = taken(seed, moving=moving)
    found = photos.calibrated(photos.log)
    truth = {
        "time_offset": photos.camera.time_offset,
        "focal_length": photos.camera.focal_length[0],
        "readout_time": photos.camera.readout_time,
    }
    errors = {name: (each.value - truth[name], each.sd) for name, each in found.values.items() if each.sd is not None}
    log = photos.log
    mirrored = GyroLog(log.t, log.omega * (1, 1, -1), log.epoch_ns)
    other = log.shifted(1.7)
    row = Row(
        accepted=found.accepted,
        mounted=found.mounting == letters(photos.camera.imu_to_camera),
        directed=found.directed,
        direction=found.camera.readout_direction == photos.camera.readout_direction,
        errors=errors,
        mirrored=photos.calibrated(mirrored).accepted,
        other=_accepts(photos, other),
    )
    print(seed, moving, row, flush=True)
    return row


def _accepts(photos: PhotoSet, log: GyroLog) -> bool:
    try:
        return photos.calibrated(log).accepted
    except RsdeblurError:
        return False


def lines(rows: dict[str, list[Row]]) -> Iterator[list[str]]:
    """Yield the lines of the table."""
    for label, group in rows.items():
        good = [row for row in group if row.accepted]
        sure = [row for row in good if row.directed]
        cells = [
            label,
            f"{len(good)} of {len(group)}",
            f"{sum(row.mounted for row in good)} of {len(good)}",
            f"{sum(row.direction for row in sure)} of {len(sure)}",
        ]
        scores = []
        for name, unit in zip(VALUES, (1e3, 1.0, 1e3), strict=True):
            pairs: FloatArray = np.array([row.errors[name] for row in good if name in row.errors]).reshape(-1, 2)
            errors = unit * np.abs(pairs[:, 0])
            cells.append(f"{np.median(errors):.2g} / {errors.max():.2g} ({len(errors)})" if len(errors) else "-")
            scores.append(f"{np.sqrt(np.mean((pairs[:, 0] / pairs[:, 1]) ** 2)):.1f}" if len(errors) else "-")
        cells += [", ".join(scores), f"{sum(row.mirrored for row in group)}", f"{sum(row.other for row in group)}"]
        yield cells


COLUMNS = (
    "motion", "accepted", "axes right", "direction right", "offset error, ms", "focal length error, px",
    "readout error, ms", "error / deviation", "mirrored logs accepted", "other logs accepted",
)  # fmt: skip


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=10, help="number of sets for each motion")
    parser.add_argument("--first", type=int, default=300, help="seed of the first set")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.sets)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        running = {label: pool.map(partial(measured, moving=moving), seeds) for label, moving in MOTIONS.items()}
        rows = {label: list(results) for label, results in running.items()}
    table = markdown(COLUMNS, lines(rows))
    report(noted(table), options.markdown)


if __name__ == "__main__":
    main()
