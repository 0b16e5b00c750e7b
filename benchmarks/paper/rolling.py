"""Figure 7: points under a rolling shutter, and the PSFs from the gyroscope."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks import data
from benchmarks.paper.figure import Cell, Figure
from rsdeblur import Camera, Exposure, psfs, simulate
from rsdeblur.motion import BlurPaths
from rsdeblur.motion.paths import Capture

DURATION = 1 / 14
TIMESTAMP = 20.0  # s in the log
STARTS = tuple(1e-3 * ms for ms in range(40, 101, 10))  # after the timestamp
CAMERA = Camera(480, 360, 528.0, readout_time=0.03)
PITCH = 60  # px between points


def figures(quick: bool) -> Iterator[Figure]:
    """Yield figure 7."""
    log = data.shake()
    points = np.zeros((CAMERA.height + 120, CAMERA.width + 120))
    points[PITCH // 2 :: PITCH, PITCH // 2 :: PITCH] = 1.0
    exposure = Exposure(TIMESTAMP + STARTS[0], DURATION, log.epoch_ns)
    grid = simulate(points, log, CAMERA, exposure).blurred
    banks = [
        psfs(log, CAMERA, Exposure(TIMESTAMP + s, DURATION, log.epoch_ns), mode="global", motion="small-angle")
        for s in STARTS
    ]
    recording = Capture.from_log(log, CAMERA, exposure)
    middle = [(CAMERA.width - 1) / 2]
    paths = BlurPaths.from_capture(recording, [0.0, CAMERA.height - 1.0], middle)
    top, bottom = paths.displacements[:, 0]
    change = float(np.linalg.norm(top - bottom, axis=-1).max())
    rows: list[tuple[Cell, ...]] = [
        (1e3 * start, float(bank.size[1]), float(bank.size[0])) for start, bank in zip(STARTS, banks, strict=True)
    ]

    def draw(canvas: Any) -> None:
        left, right = canvas.subfigures(1, 2, width_ratios=(2, 3))
        axes = left.subplots()
        axes.imshow(grid / np.quantile(grid, 0.999), cmap="gray", vmin=0, vmax=1)
        axes.set_title("grid of points, 1/14 s", fontsize=8)
        axes.axis("off")
        side = max(max(bank.size) for bank in banks)
        for axes, start, bank in zip(right.subplots(1, len(banks)), STARTS, banks, strict=True):
            tall, wide = bank.size
            kernel = np.pad(bank.kernels[0, 0], [((side - n) // 2,) * 2 for n in (tall, wide)])
            axes.imshow(np.sqrt(kernel / kernel.max()), cmap="gray")
            axes.set_title(f"{1e3 * start:.0f} ms", fontsize=8)
            axes.axis("off")

    yield Figure(
        "fig7",
        "Figure 7: a rolling shutter's point grid",
        f"A grid of points, exposure 1/14 s, readout 30 ms, a {data.REAL} phone's shake; and the PSFs that the "
        "gyroscope gives for exposures that start 40 to 100 ms after a timestamp. Sizes in px.",
        f"Holds: points of one exposure trace different curves from row to row (those of the first and the last row "
        f"are up to {change:.1f} px apart at equal times), and the curves are those of the log read later.",
        ("start (ms)", "width", "height"),
        rows,
        draw,
    )
