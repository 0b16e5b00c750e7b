"""A clip of which a tenth is blurred: ``python -m benchmarks.gated_video [--size 640x480] [--rounds 3]``.

The clip has 100 frames, lossless (FFV1), of a camera that drifts slowly and is jerked in 10 of them. `rsdeblur video`
runs as a user runs it, with the default threshold and with ``--all``. Reported are the processor time, which other work
on the machine hardly changes; the number of frames whose decoded picture differs from the input's; and the flicker of
brightness and sharpness: the rms difference between consecutive frames of the mean luma and of the mean gradient of the
luma, both in levels of 8 bits.

The exit code is 1 if a frame changed that should not, or if the default flickers more than the input.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
from fractions import Fraction
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import size
from benchmarks.tables import markdown, write
from rsdeblur import Camera, Exposure, GyroLog, scene, simulate_clip

FRAMES, INTERVAL, DURATION, READOUT = 100, Fraction(1, 30), 1 / 60, 0.01
JERKED = (5, 16, 24, 33, 42, 57, 66, 75, 83, 94)
# Paths in px at a width of 640 px: of the drift, and of a jerk at its fastest. Only the latter exceeds 1.5 px.
DRIFT, JERK = 0.3, 12.0
FOCAL = 1.1  # picture widths
RATE = 1000  # samples of the gyro per second
NOISE = 0.005
MARGIN = 0.15  # of the scene beyond the frame, in widths
START = 0.1  # s
# Relative excess of flicker that is rounding to 8 bits.
ROUNDING = 1.01


class Flicker(NamedTuple):
    """Rms difference between consecutive frames, in levels of 8 bits."""

    brightness: float
    sharpness: float


def shaken() -> GyroLog:
    """Return the log: a slow drift about y, and jerks that last one frame, in turns to the right and to the left.

    A jerk goes up and down at the same time, so that its path is bent.
    """
    t = np.arange(0.0, START + float(FRAMES * INTERVAL) + START, 1 / RATE)
    pixel_rate = 1 / (640 * FOCAL * DURATION)
    omega = np.zeros((t.size, 3))
    omega[:, 1] = DRIFT * pixel_rate
    for i, n in enumerate(JERKED):
        # The window of a frame begins with its interval; the jerk fills the window and no other.
        phase = ((t - START - float(n * INTERVAL)) / (DURATION + READOUT)).clip(0, 1)
        omega[:, 1] += (-1) ** i * JERK * pixel_rate * np.sin(np.pi * phase) ** 2
        omega[:, 0] += JERK * pixel_rate * np.sin(2 * np.pi * phase)
    return GyroLog(t, omega)


def film(folder: Path, width: int, height: int) -> list[str]:
    """Simulate the clip and its files; return the arguments of `rsdeblur video`."""
    import av

    camera = Camera(width, height, FOCAL * width, readout_time=READOUT)
    log = shaken()
    exposures = [Exposure(START + float(n * INTERVAL), DURATION) for n in range(FRAMES)]
    margin = round(MARGIN * width)
    sharp = scene(height + 2 * margin, width + 2 * margin)
    with av.open(str(folder / "clip.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=1 / INTERVAL)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for frame in simulate_clip(sharp, log, camera, exposures, noise=NOISE, transfer="linear"):
            stored = np.rint(255 * np.clip(frame, 0, 1) ** (1 / 2.2)).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(stored, format="rgb24")))
        container.mux(stream.encode())
    table = np.column_stack([log.t, log.omega])
    np.savetxt(folder / "gyro.csv", table, "%.9f", ",", header="t,wx,wy,wz", comments="")
    camera.save(folder / "camera.toml")
    recording = {"--gyro": "gyro.csv", "--camera": "camera.toml", "--start": START, "--duration": DURATION}
    return ["video", "clip.mkv", *(str(word) for pair in recording.items() for word in pair), "--codec", "ffv1"]


def deblurred(arguments: list[str], folder: Path, output: str) -> float:
    """Run the program; return its processor time in s."""
    begin = resource.getrusage(resource.RUSAGE_CHILDREN)
    words = [sys.executable, "-P", "-m", "rsdeblur", *arguments, "--quiet", "--force", "-o", output]
    subprocess.run(words, cwd=folder, check=True)
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    return end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime


def decoded(path: Path) -> list[NDArray[np.uint8]]:
    """Return all planes of every frame, as stored."""
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray() for frame in container.decode(video=0)]


def flicker(frames: list[NDArray[np.uint8]], height: int) -> Flicker:
    """Return the flicker of decoded frames; the luma is the first `height` rows."""
    luma = [frame[:height].astype(np.float64) for frame in frames]
    gradients = [sum(np.abs(np.diff(y, axis=axis)).mean() for axis in (0, 1)) for y in luma]
    means = [y.mean() for y in luma]
    return Flicker(*(float(np.sqrt(np.mean(np.diff(values) ** 2))) for values in (means, gradients)))


def main() -> None:
    """Film, deblur, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=size, default=(640, 480), help="width x height of the clip (640x480)")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each kind (3)")
    parser.add_argument("--markdown", type=Path, help="write the table")
    options = parser.parse_args()
    width, height = options.size
    runs: dict[str, list[str]] = {"default": [], "all": ["--all"]}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arguments = film(folder, width, height)
        for _ in range(options.rounds):
            for run, more in runs.items():
                seconds[run].append(deblurred([*arguments, *more], folder, f"{run}.mkv"))
        clips = {"input": decoded(folder / "clip.mkv")}
        clips |= {run: decoded(folder / f"{run}.mkv") for run in runs}
    shakes = {name: flicker(frames, height) for name, frames in clips.items()}
    changed = {
        name: [n for n, pair in enumerate(zip(frames, clips["input"], strict=True)) if not np.array_equal(*pair)]
        for name, frames in clips.items()
    }
    lines = [
        (
            name,
            f"{len(changed[name])} of {FRAMES}",
            f"{median(seconds[name]) / median(seconds['all']):.2f}" if name in seconds else "",
            f"{shake.brightness:.3f}",
            f"{shake.sharpness:.3f}",
        )
        for name, shake in shakes.items()
    ]
    columns = ("clip", "frames that differ", "processor time / --all", "flicker: brightness", "sharpness")
    text = markdown(columns, lines)
    print(text)
    if options.markdown:
        write(options.markdown, text)
    if set(changed["default"]) - set(JERKED):
        sys.exit(f"frames changed that are not blurred: {sorted(set(changed['default']) - set(JERKED))}")
    if any(own > ROUNDING * before for own, before in zip(shakes["default"], shakes["input"], strict=True)):
        sys.exit("the result flickers more than the input")


if __name__ == "__main__":
    main()
