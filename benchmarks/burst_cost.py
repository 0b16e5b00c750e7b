"""Cost of frames deblurred together: ``python -m benchmarks.burst_cost [--memory]``.

Processor and wall time of 4 frames of 3 megapixels together, and of the same frames one by one: medians of rounds in
which both are measured by turns. With --memory instead, the peak memory of 8 frames of 12 megapixels.
"""

from __future__ import annotations

import argparse
import resource
import time
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from benchmarks.tables import markdown, write
from rsdeblur import Camera, Exposure, GyroLog, deblur, deblur_burst, hand_shake, simulate_clip
from rsdeblur.choices import Mode, Prior
from rsdeblur.simulation.scene import scene

# Megapixels and frames of both measurements.
TIMED, TIMED_FRAMES, ROUNDS = 3, 4, 3
LARGE, MANY_FRAMES = 12, 8
METHODS: tuple[tuple[Mode, Prior], ...] = tuple(
    (mode, prior) for mode in ("banded", "rowwise") for prior in ("wiener", "hyper-laplacian")
)
# Exposure times and the time from one exposure to the next, s.
DURATION, STEP = 1 / 30, 0.1

Burst = tuple[list[NDArray[np.uint8]], GyroLog, Camera, list[Exposure]]


def burst_of(megapixels: int, count: int, *, strength: float = 0.3) -> Burst:
    """Simulate frames of 8 bits; a camera has the aspect ratio 4 : 3, see :func:`enlarged_burst`."""
    width = 4 * round((megapixels * 1e6 * 4 / 3) ** 0.5 / 16) * 4
    return enlarged_burst(Camera(width, width * 3 // 4, 1.1 * width, readout_time=0.03), count, strength=strength)


def enlarged_burst(camera: Camera, count: int, *, strength: float) -> Burst:
    """Simulate frames of 8 bits at a quarter of their size, and enlarge them; the blur is that of the full size.

    They are enlarged smoothly: equal pixels beside each other would show the sensor, not the scene, and so misfit.
    """
    log = hand_shake(STEP * (count + 3), strength=strength, seed=3)
    exposures = [Exposure(STEP * (n + 1), DURATION) for n in range(count)]
    small = camera.scaled(1 / 4)
    sharp = scene(small.height + 40, small.width + 40)
    frames = []
    for frame in simulate_clip(sharp, log, small, exposures, noise=0.005, transfer="srgb"):
        stored = (255 * frame.clip(0, 1)).astype(np.uint8)
        frames.append(
            np.asarray(Image.fromarray(stored).resize((camera.width, camera.height), Image.Resampling.BICUBIC))
        )
    return frames, log, camera, exposures


def seconds(burst: Burst, mode: Mode, prior: Prior, *, together: bool) -> tuple[float, float]:
    """Return the processor and the wall time of the frames together, or one by one."""
    frames, log, camera, exposures = burst
    begin = time.process_time(), time.perf_counter()
    if together:
        deblur_burst(frames, log, camera, exposures, mode=mode, prior=prior, saturation="ignore", check=False)
    else:
        for frame, exposure in zip(frames, exposures, strict=True):
            deblur(frame, log, camera, exposure, mode=mode, prior=prior, saturation="ignore", check=False)
    return time.process_time() - begin[0], time.perf_counter() - begin[1]


def time_table() -> str:
    """Measure all modes and priors."""
    burst, lines = burst_of(TIMED, TIMED_FRAMES), []
    for mode, prior in METHODS:
        # The first round loads compiled code.
        rounds = [[seconds(burst, mode, prior, together=kind) for kind in (False, True)] for _ in range(ROUNDS + 1)][1:]
        single, several = ([median(times) for times in zip(*kind, strict=True)] for kind in zip(*rounds, strict=True))
        ratios = (f"{b / a:.2f}" for a, b in zip(single, several, strict=True))
        lines.append((f"{mode}, {prior}", *(f"{s:.1f}" for s in (*single, *several)), *ratios))
    header = ("mode, prior", "one by one: CPU s", "wall s", "together: CPU s", "wall s", "CPU ratio", "wall ratio")
    return markdown(header, lines)


def peak() -> float:
    """Return the peak memory of this process, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def memory_table() -> str:
    """Measure the peak memory; each mode may only raise that of the modes in front of it."""
    frames, log, camera, exposures = burst_of(LARGE, MANY_FRAMES)
    out, lines = np.empty_like(frames[0]), []
    for mode in ("banded", "rowwise"):
        deblur_burst(
            *(frames, log, camera, exposures),
            mode=mode,
            prior="hyper-laplacian",
            saturation="ignore",
            check=False,
            out=out,
        )
        lines.append((f"{mode}, hyper-laplacian", f"{peak():.0f}"))
    return markdown(("mode, prior", "peak memory, MiB"), lines)


def main() -> None:
    """Run one of the measurements and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--memory", action="store_true", help="measure the peak memory instead of the time")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    text = memory_table() if options.memory else time_table()
    if options.markdown:
        write(options.markdown, text)
    Console(width=200, highlight=False, markup=False).print(text)


if __name__ == "__main__":
    main()
