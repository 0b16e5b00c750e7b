"""Load: ``python -m benchmarks.load batch|threads|processes|log``.

- ``batch``: many small pictures through `rsdeblur batch`, and the memory of its processes over time.
- ``threads``: solvers used by several threads at once.
- ``processes``: solvers used after a fork, and in new processes.
- ``log``: long gyro logs, read and used.

Memory is the private memory of processes (Linux: RssAnon).
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.captures import Image
from benchmarks.tables import print_table
from rsdeblur import BlurPaths, Camera, Capture, Deconvolver, Exposure, RowBlur, RowDeconvolver, deblur, psfs
from rsdeblur.deconv.priors import DerivativePrior
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.io import write_picture
from rsdeblur.simulation.shake import hand_shake

THREADS = 8
POLL = 0.05
HEIGHT, WIDTH = 48, 64
CAMERA = Camera(WIDTH, HEIGHT, 60.0, readout_time=0.03)
EXPOSURE = Exposure(0.1, 0.03)
Apply = Callable[..., Image]


def _pictures(count: int, channels: int = 3) -> Image:
    return np.random.default_rng(0).random((count, HEIGHT, WIDTH, channels), dtype=np.float32)


def _recording() -> tuple[Any, ...]:
    return hand_shake(0.3, seed=1), CAMERA, EXPOSURE


def solvers(threads: int) -> dict[str, Apply]:
    """Return a solver of each kind, planned once, as a function of a picture and `out`."""
    shape = (HEIGHT, WIDTH, 3)
    tiles = {"global": (1, 1), "banded": (4, 1), "banded and strips": (4, 3)}
    banks = {name: psfs(*_recording(), bands=bands, strips=strips) for name, (bands, strips) in tiles.items()}
    paths = BlurPaths.every_row(Capture.from_log(*_recording()), banks["banded and strips"].cols)
    blur = RowBlur(paths, WIDTH, channels=3, threads=threads)
    quadratic = TileQuadratic(banks["banded and strips"], shape, threads=threads)

    def total_variation(picture: Image, out: Image | None = None) -> Image:
        return _into(out, quadratic.apply(picture, prior=DerivativePrior("tv", 1e-3)))

    def row_blur(picture: Image, out: Image | None = None) -> Image:
        return _into(out, blur.forward(blur.adjoint(picture)))

    by_name: dict[str, Apply] = {name: Deconvolver(bank, shape, threads=threads).apply for name, bank in banks.items()}
    methods: tuple[Literal["direct", "cg"], ...] = ("direct", "cg")
    for method in methods:
        by_name[f"rowwise, {method}"] = RowDeconvolver(paths, shape, solver=method, threads=threads).apply
    return by_name | {"total variation": total_variation, "RowBlur": row_blur}


def _into(out: Image | None, result: Image) -> Image:
    if out is None:
        return result
    out[...] = result
    return out


def shared_by_threads(apply: Apply, count: int) -> Counter[str]:
    """Let 8 threads apply one solver to `count` pictures each; compare with the results of one thread."""
    pictures = _pictures(THREADS)
    expected = [apply(picture).tobytes() for picture in pictures]
    start = threading.Barrier(THREADS)

    def work(thread: int) -> list[str]:
        outcomes = []
        start.wait()
        for i in range(count):
            which = (3 * thread + i) % len(pictures)
            # Write to a new array, to a given array, and in place.
            picture = pictures[which].copy()
            out = (None, np.empty_like(picture), picture)[i % 3]
            outcomes.append("the same bits" if apply(picture, out).tobytes() == expected[which] else "other bits")
        return outcomes

    with ThreadPoolExecutor(THREADS) as pool:
        return Counter(state for states in pool.map(work, range(THREADS)) for state in states)


def in_processes(method: str, count: int, limit: float = 60.0) -> Counter[str]:
    """Use solvers and `deblur` in `count` processes, forked or spawned by a process that used them before."""
    picture = _pictures(1)[0]
    mine = solvers(threads=2)
    mine |= {f"deblur, {mode}": partial(_deblur, mode=mode) for mode in ("banded", "rowwise")}
    expected = {name: apply(picture).tobytes() for name, apply in mine.items()}
    context, outcomes = get_context(method), Counter[str]()
    # A forked process inherits the solvers while another thread of the parent uses them.
    busy, working = threading.Event(), mine["banded"]
    other = threading.Thread(target=lambda: [working(picture) for _ in iter(busy.is_set, True)])
    other.start()
    try:
        for _ in range(count):
            queue = context.Queue()
            arguments = (queue, mine if method == "fork" else None, picture)
            process = context.Process(target=_answer, args=arguments)  # type: ignore[attr-defined]  # of both contexts
            process.start()
            try:
                answers = queue.get(timeout=limit)
                outcomes.update(
                    "the same bits" if answers[name] == expected[name] else "other bits" for name in expected
                )
            except Exception:  # no answer in time
                outcomes["no answer"] += 1
                process.kill()
            process.join()
            outcomes[f"exit {process.exitcode}"] += 1
    finally:
        busy.set()
        other.join()
    return outcomes


def _deblur(picture: Image, *, mode: Literal["banded", "rowwise"]) -> Image:
    return deblur(picture, *_recording(), mode=mode, prior="wiener").image


def _answer(queue: Any, inherited: dict[str, Apply] | None, picture: Image) -> None:
    mine = inherited
    if mine is None:
        mine = solvers(threads=2) | {f"deblur, {mode}": partial(_deblur, mode=mode) for mode in ("banded", "rowwise")}
    queue.put({name: apply(picture).tobytes() for name, apply in mine.items()})


def write_batch(folder: Path, count: int, size: tuple[int, int] = (HEIGHT, WIDTH)) -> list[str]:
    """Write ten pictures, a log, a camera and a manifest of `count` items; return the arguments for `batch`."""
    rng, (height, width) = np.random.default_rng(0), size
    for i in range(10):
        write_picture(folder / f"{i}.png", rng.integers(0, 256, (height, width, 3), np.uint8))
    log = hand_shake(1.0, seed=1)
    np.savetxt(
        folder / "gyro.csv", np.column_stack([log.t, log.omega]), delimiter=",", header="t,wx,wy,wz", comments=""
    )
    Camera(width, height, 0.9 * width, readout_time=0.03).save(folder / "camera.toml")
    items = (f"{i % 10}.png,{i}.png,{0.1 + 0.7 * i / count:.6f},0.03" for i in range(count))
    (folder / "manifest.csv").write_text("\n".join(["photo,output,start,duration", *items]) + "\n")
    return ["batch", "manifest.csv", "--gyro", "gyro.csv", "--camera", "camera.toml", "-o", "sharp"]


def start(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a command of rsdeblur and discard its output."""
    command, nowhere = [sys.executable, "-P", "-m", "rsdeblur", *arguments], subprocess.DEVNULL
    return subprocess.Popen(command, cwd=folder, stdout=nowhere, stderr=nowhere)


def workers_of(process: subprocess.Popen[bytes]) -> list[int]:
    """Return the process ids of the workers of a command, without the helper process of multiprocessing."""
    try:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        return [int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    except OSError:
        return []


def _own(pid: int) -> int:
    try:
        lines: Sequence[str] = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("RssAnon")), 0)


def batch(count: int, jobs: int) -> None:
    """Print the memory of the parent and the workers of a batch, by tenths of its pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder, seen = Path(name), list[list[int]]()
        begin = time.perf_counter()
        with start(folder, *write_batch(folder, count), "--jobs", str(jobs), "--threads", "1") as process:
            while process.poll() is None:
                workers = [_own(pid) for pid in workers_of(process)]
                if workers and (folder / "sharp").is_dir():
                    done = len(list((folder / "sharp").glob("[0-9]*.png")))
                    seen.append([done, _own(process.pid), *sorted(workers)])
                time.sleep(POLL)
        seconds, done = time.perf_counter() - begin, len(list((folder / "sharp").glob("[0-9]*.png")))
    rows = []
    for tenth in range(10):
        within = [sample for sample in seen if tenth * count <= 10 * sample[0] < (tenth + 1) * count]
        most = [max(sample[k] for sample in within if len(sample) > k) / 2**20 for k in range(1, 2 + jobs)]
        rows.append([f"{tenth * count // 10} to {(tenth + 1) * count // 10}", *(f"{value:.0f}" for value in most)])
    print_table(["pictures", "parent, MiB", *(f"worker {i + 1}, MiB" for i in range(jobs))], rows)
    print(f"{done} of {count} pictures written, exit code {process.returncode}, {seconds:.0f} s")


FORMATS = {
    "plain, ns": "t_ns,wx,wy,wz\n",
    "plain, s": "t,wx,wy,wz\n",
    "gcsv": "GYROFLOW IMU LOG\nversion,1.3\norientation,XYZ\ntscale,0.001\ngscale,0.001\nt,gx,gy,gz\n",
    "sensorlogger": "time,seconds_elapsed,z,y,x\n",
}


def _lines(name: str, count: int, rate: float) -> Iterator[str]:
    """Yield the lines of a log, 100,000 samples at a time, with rates from a pool of that size."""
    rates = np.random.default_rng(0).normal(0, 0.1, (100_000, 3))
    written = "%d,%d,%d" if name == "gcsv" else "%.15g,%.15g,%.15g" if name == "sensorlogger" else "%.9g,%.9g,%.9g"
    pool = [written % tuple(1e3 * rate if name == "gcsv" else rate) for rate in rates]
    step = round(1e9 / rate)
    for first in range(0, count, len(pool)):
        timestamps = range(first * step, min(first + len(pool), count) * step, step)
        if name == "plain, ns":
            yield "".join(f"{1309154983495295 + ns},{rates}\n" for ns, rates in zip(timestamps, pool, strict=False))
        elif name == "sensorlogger":
            day = 1766385749427863800
            yield "".join(f"{day + ns},{ns / 1e9:.9f},{rates}\n" for ns, rates in zip(timestamps, pool, strict=False))
        else:
            scale = 1e-6 if name == "gcsv" else 1e-9
            yield "".join(f"{scale * ns:.6f},{rates}\n" for ns, rates in zip(timestamps, pool, strict=False))


def _used() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def long_log(samples: int, formats: Sequence[str], folder: Path | None) -> None:
    """Print time and memory of `info` and `deblur` with logs of `samples` samples over 24 hours."""
    rows = []
    with tempfile.TemporaryDirectory(dir=folder) as name:
        place = Path(name)
        write_picture(place / "photo.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        Camera(WIDTH, HEIGHT, 110.0, readout_time=0.03).save(place / "camera.toml")
        for format in formats:
            with (place / "log.csv").open("w") as file:
                file.write(FORMATS[format])
                file.writelines(_lines(format, samples, samples / 86400))
            length = (place / "log.csv").stat().st_size / 2**20
            at = {"plain, ns": 1309154983495295, "sensorlogger": 1766385749427863800}.get(format, 0) + 43_200 * 10**9
            recording = [
                "--camera",
                "camera.toml",
                "--start-ns",
                str(at),
                "--duration",
                "0.03",
                "-o",
                "out.png",
                "--force",
            ]
            for command in (["info", "log.csv"], ["deblur", "photo.png", "--gyro", "log.csv", *recording]):
                begin, used, peak = time.perf_counter(), _used(), 0
                with start(place, *command) as process:
                    while process.poll() is None:
                        peak = max(peak, _own(process.pid))
                        time.sleep(POLL)
                seconds = [f"{time.perf_counter() - begin:.1f}", f"{_used() - used:.1f}"]
                size, most, code = f"{length:.0f}", f"{peak / 2**20:.0f}", str(process.returncode)
                rows.append([format, size, command[0], *seconds, most, code])
    print_table(["format", "MiB", "command", "s", "processor, s", "most MiB", "exit code"], rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one part and print its table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.load", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=["batch", "threads", "processes", "log"])
    parser.add_argument("--count", type=int, help="pictures, rounds, processes or samples (1000, 100, 10, 20000000)")
    parser.add_argument("--jobs", type=int, default=2, help="batch: processes (2)")
    parser.add_argument("--format", choices=FORMATS, action="append", help="log: only these formats (all)")
    parser.add_argument("--folder", type=Path, help="log: folder for the log (the system's temporary folder)")
    options = parser.parse_args(arguments)
    if options.part == "batch":
        batch(options.count or 1000, options.jobs)
    elif options.part == "threads":
        for threads in (1, 2):
            for name, apply in solvers(threads).items():
                outcomes = dict(shared_by_threads(apply, options.count or 100))
                print(f"{name}, {threads} internal threads: {outcomes}", flush=True)
    elif options.part == "processes":
        for method in ("fork", "spawn"):
            print(f"{method}: {dict(in_processes(method, options.count or 10))}", flush=True)
    else:
        long_log(options.count or 20_000_000, options.format or list(FORMATS), options.folder)


if __name__ == "__main__":
    main()
