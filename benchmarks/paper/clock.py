"""The time offset, which the authors leave to the user's eye, estimated by `find_time_offset`."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import data
from benchmarks.data import DATA, ROOT
from benchmarks.paper.figure import Cell, Figure
from rsdeblur import Camera, Exposure, GyroLog, find_time_offset, read_camera, read_captures, read_gyro, simulate
from rsdeblur._util.threads import thread_count
from rsdeblur.estimate import OffsetSearch
from rsdeblur.io import read_picture
from rsdeblur.motion import Capture

PICTURES = ("kodim01", "kodim03", "kodim05", "kodim07", "kodim13", "kodim20", "kodim23")
DURATIONS = (1 / 60, 1 / 30, 1 / 15)
CAMERA = Camera(640, 448, 700.0, readout_time=0.03)
NOISE = 0.01
SEARCH = (-0.1, 0.1)
LARGEST = 0.05  # s, either way
# Least blur at which an answer is expected, px.
ENOUGH = 8.0
UNIFORM = ((0.0, 0.0, 0.0), (0.3, 0.9, 0.1), (-1.0, 0.4, 0.0), (0.0, 2.0, 0.3))  # rad/s


@dataclass(frozen=True, slots=True)
class Trial:
    """One search: blur (px), true offset (s) and result."""

    blur: float
    offset: float
    result: OffsetSearch

    @property
    def error(self) -> float:
        """Error of the best guess, ms, whether or not it was returned as an answer."""
        return 1e3 * abs(self.result.best - self.offset)


def figures(quick: bool) -> Iterator[Figure]:
    """Yield the figure of the accuracy of the search."""
    log = data.shake()
    rng = np.random.default_rng(5)
    count = 4 if quick else 16
    moments, offsets = rng.uniform(2.0, 54.0, count), np.linspace(-LARGEST, LARGEST, count)
    names = [PICTURES[k % len(PICTURES)] for k in range(count)]
    durations = [DURATIONS[k % len(DURATIONS)] for k in range(count)]
    # Each search uses one processor.
    with ProcessPoolExecutor(thread_count(None), mp_context=get_context("spawn")) as pool:
        trials = [*pool.map(partial(trial, log), names, moments, durations, offsets)]
        even = [*pool.map(uniform, UNIFORM[:1] if quick else UNIFORM)]
        pictures = [*real(pool)]
    yield accuracy(trials, even, pictures)


def trial(log: GyroLog, picture: str, start: float, duration: float, offset: float) -> Trial:
    """Simulate a capture with a real shake and search for its known offset."""
    near = log.trimmed(start - 0.4, start + 0.5)
    exposure = Exposure(start, duration, log.epoch_ns)
    sharp = data.light(picture)
    blurred = simulate(sharp, near, CAMERA, exposure, noise=NOISE).blurred
    blur = float(Capture.from_log(near, CAMERA, exposure).probe.lengths.mean())
    return Trial(blur, offset, find_time_offset(blurred, near.shifted(-offset), CAMERA, exposure, search=SEARCH))


def uniform(rates: tuple[float, float, float]) -> OffsetSearch:
    """Search in a capture in which every offset gives the same blur."""
    log, exposure = GyroLog(np.arange(0, 1.0, 0.005), np.tile(rates, (200, 1))), Exposure(0.4, 1 / 30)
    sharp = data.light("kodim05")
    blurred = simulate(sharp, log, CAMERA, exposure, noise=NOISE).blurred
    return find_time_offset(blurred, log, CAMERA, exposure, search=SEARCH)


def real(pool: Executor) -> Iterator[tuple[str, OffsetSearch]]:
    """Search in the real pictures, if they are there, around the offsets of their camera files."""
    if not data.RECORDED:
        return
    folder, camera = DATA / "real" / "mars-phone-240ms", read_camera(ROOT / "docs/cameras/mars-phone-240ms.toml")
    log, captures = read_gyro(folder / "gyro_accel.csv"), read_captures(folder / "movie_metadata.csv")
    jobs = {
        f"mars-phone-240ms, frame {index}": (folder / f"frame{index}.jpg", log, camera, captures[index])
        for index in (2, 4)
    }
    folder, camera = DATA / "real" / "shield-burst", read_camera(ROOT / "docs/cameras/shield-burst.toml")
    log, captures = read_gyro(folder / "imu.txt"), read_captures(folder / "images" / "images.txt")
    jobs["shield-burst, 0004"] = folder / "images" / "0004.jpg", log, camera, captures[3]
    yield from zip(jobs, pool.map(search_photo, *zip(*jobs.values(), strict=True)), strict=True)


def search_photo(photo: Path, log: GyroLog, camera: Camera, exposure: Exposure) -> OffsetSearch:
    """Search relative to the offset of the camera file, so that the answer is the difference from it."""
    pixels, known = read_picture(photo).pixels, camera.time_offset
    early = replace(camera, time_offset=camera.time_offset - known)
    return find_time_offset(pixels, log.shifted(known), early, exposure, transfer="srgb")


def accuracy(trials: list[Trial], even: list[OffsetSearch], pictures: list[tuple[str, OffsetSearch]]) -> Figure:
    """Return the figure."""
    classes = {
        f"simulated, blur under {ENOUGH:g} px": [t for t in trials if t.blur < ENOUGH],
        f"simulated, blur of {ENOUGH:g} px and more": [t for t in trials if t.blur >= ENOUGH],
    }
    rows: list[tuple[Cell, ...]] = []
    for name, members in classes.items():
        answered = [t for t in members if t.result.time_offset is not None]
        errors = [t.error for t in answered]
        middle, worst = (float(np.median(errors)), max(errors)) if errors else ("-", "-")
        rows.append(
            (name, len(members), len(answered), middle, worst, 1e3 * float(np.median([t.result.sd for t in members])))
        )
    false = sum(search.time_offset is not None for search in even)
    rows.append(("simulated, constant rates", len(even), false, "-", "-", 1e3 * float(np.median([s.sd for s in even]))))
    for name, search in pictures:
        is_answered = search.time_offset is not None
        off = 1e3 * abs(search.best) if is_answered else "-"
        rows.append((name, 1, int(is_answered), off, off, 1e3 * search.sd))
    enough = classes[f"simulated, blur of {ENOUGH:g} px and more"]
    answered = [t for t in enough if t.result.time_offset is not None]
    median = float(np.median([t.error for t in answered]))

    def draw(canvas: Any) -> None:
        axes = canvas.subplots()
        for label, marker, members in (
            ("answered", "o", [t for t in trials if t.result.time_offset is not None]),
            ("best guess where declined", "x", [t for t in trials if t.result.time_offset is None]),
        ):
            axes.plot([1e3 * t.offset for t in members], [1e3 * t.result.best for t in members], marker, label=label)
        axes.axline((0, 0), slope=1, color="0.6", linewidth=0.8)
        axes.set(xlabel="true offset (ms)", ylabel="estimate (ms)")
        axes.grid(alpha=0.3)
        axes.legend()

    return Figure(
        "clock",
        "The time offset, estimated from the picture",
        f"{len(trials)} captures of {CAMERA.width}x{CAMERA.height} px with a {data.REAL} phone's shake at random "
        f"moments, 1/60 to 1/15 s, readout 30 ms, noise of 40 dB; the log is off by up to {1e3 * LARGEST:g} ms either "
        f"way, the search goes from {1e3 * SEARCH[0]:g} to {1e3 * SEARCH[1]:g} ms. Constant rates blur alike at "
        "every offset. "
        "The offsets of the real pictures are compared with those of their camera files, which are accurate to some "
        "5 ms (mars) or to an unknown extent (shield). Errors in ms.",
        f"New here: where the blur is {ENOUGH:g} px and more, {len(answered)} of {len(enough)} offsets are found, with "
        f"a median error of {median:.2f} ms; for {len(even)} constant rates it gives {false} answers.",
        ("pictures", "number", "answered", "median error", "worst", "median deviation, ms"),
        rows,
        draw,
    )
