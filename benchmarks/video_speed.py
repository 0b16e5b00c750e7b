"""Frames a second of a video: ``python -m benchmarks.video_speed [--size 1920x1080] [--strength 0.2] [--rounds 3]``.

A simulated clip is deblurred and encoded as `rsdeblur video --above 0` does it, one frame for each core at a time:
decoding, PSFs of each frame, solve, conversions and encoder. The time of a clip of a few frames is subtracted from that
of all, so that the first frame does not count; a long video hardly needs it. The clip has about 110 KiB per frame of
1920x1080 px: 26 Mbit/s at 30 frames per s, where phones store 16 to 20.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from fractions import Fraction
from pathlib import Path
from statistics import median

import av

from benchmarks.cases import Burst, enlarged_burst, size
from benchmarks.tables import markdown, report
from rsdeblur import Camera, Options
from rsdeblur._util import memory
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import Quality
from rsdeblur.video.clip import open_clip
from rsdeblur.video.encode import Encoding, deblur_video
from rsdeblur.video.plan import ClipPlan, plan_clip

# Frames of the clip, those whose time is subtracted, and the clip's rate factor.
FRAMES, FEW, CRF = 28, 8, "24"
QUALITIES: tuple[Quality, ...] = ("fast", "balanced")


def film(burst: Burst, count: int, path: Path) -> None:
    """Store the first frames of a burst as a video of H.264."""
    frames, _, camera, _ = burst
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(10), options={"crf": CRF, "preset": "fast"})
        stream.width, stream.height, stream.pix_fmt = camera.width, camera.height, "yuv420p"
        for frame in frames[:count]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame)))
        container.mux(stream.encode())


def planned(path: Path, burst: Burst, quality: Quality) -> ClipPlan:
    """Plan the deblurring of all frames of a video."""
    clip, (_, log, camera, exposures) = open_clip(path), burst
    options = Options(quality=quality, threads=1, check=False)
    return plan_clip(clip, log, camera, exposures[: len(clip)], options, above=0.0)


def seconds_per_frame(few: ClipPlan, plan: ClipPlan, out: Path, jobs: int) -> float:
    """Return the time of a frame beyond the first ones."""
    times = []
    for each in (few, plan):
        begin = time.perf_counter()
        deblur_video(each, out, encoding=Encoding.like(each.clip), jobs=jobs, force=True)
        times.append(time.perf_counter() - begin)
    return (times[1] - times[0]) / (len(plan.clip) - len(few.clip))


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=size, default=(1920, 1080), help="width x height of the frames (1920x1080)")
    parser.add_argument("--strength", type=float, default=0.2, help="strength of the shake (0.2)")
    parser.add_argument("--rounds", type=int, default=3, help="times that each quality is measured (3)")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    width, height = options.size
    burst = enlarged_burst(Camera(width, height, 1.1 * width, readout_time=0.03), FRAMES, strength=options.strength)
    lines, jobs = [], thread_count(None)
    memory.keep()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [folder / "few.mp4", folder / "film.mp4"]
        for path, count in zip(paths, (FEW, FRAMES), strict=True):
            film(burst, count, path)
        for quality in QUALITIES:
            few, plan = (planned(path, burst, quality) for path in paths)
            seconds = median(seconds_per_frame(few, plan, folder / "out.mkv", jobs) for _ in range(options.rounds))
            (bands, strips), (tall, wide) = plan.tiles, plan.psf_size
            psfs = f"{bands} x {strips} of {wide}x{tall} px"
            lines.append((f"{width}x{height}, {quality}", psfs, f"{seconds:.2f}", f"{1 / seconds:.1f}"))
    text = markdown(("video", "PSFs (bands x strips) at most", "s per frame", "frames per s"), lines)
    report(text, options.markdown)


if __name__ == "__main__":
    main()
