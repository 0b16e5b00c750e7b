"""Faults while files are written and FFTs are planned: ``python -m benchmarks.faults [--kills N]``.

Processes are killed, interrupted, run out of disk and get damaged caches. The file left on disk must be the old one or
the new one, and the next run must work.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import load
from rsdeblur import Camera, Deconvolver, PsfBank, cli
from rsdeblur._util import workers
from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.interrupts import ENDING
from rsdeblur.choices import Planning
from rsdeblur.deconv import fft
from rsdeblur.errors import OutputError
from rsdeblur.io import read_picture, write_picture
from rsdeblur.io.picture_output import picture_to_fill
from rsdeblur.io.pictures import Picture
from rsdeblur.simulation.shake import hand_shake

SIDE = 200


def _picture(name: str) -> tuple[Callable[[Path, int], None], Callable[[Path], Any]]:
    pictures = [np.random.default_rng(i).integers(0, 256, (SIDE, SIDE, 3), np.uint8) for i in range(2)]
    return lambda path, i: write_picture(path, pictures[i], force=True), lambda path: read_picture(path).pixels


def _wisdom(path: Path, which: int) -> None:
    with atomic_write(path) as file:
        file.write(bytes([which]) * 50_000)


WRITERS: dict[str, tuple[Callable[[Path, int], None], Callable[[Path], Any]]] = {
    **{name: _picture(name) for name in ("a.jpg", "a.png", "a.tif", "a.webp")},
    "camera.toml": (lambda path, i: Camera(640 + i, 480, 500.0).save(path), Camera.load),
    "bank.npz": (
        lambda path, i: PsfBank(np.full((2, 1, 3, 3), 1 / 9), np.arange(2.0) + i, np.zeros(1)).save(path),
        PsfBank.load,
    ),
    "fftw.wisdom": (_wisdom, lambda path: path.read_bytes()),
}


def _write_for_ever(write: Callable[[Path, int], None], path: Path, ready: Any) -> None:
    which = 0
    while True:
        write(path, which)
        ready.set()
        which = 1 - which


def kills(name: str, count: int) -> dict[str, int]:
    """Kill a process that writes one file repeatedly, at random moments; count what was left on disk."""
    write, read = WRITERS[name]
    counts = {"the old or the new file": 0, "another file": 0, "temporary files left": 0, "left by the next write": 0}
    rng = random.Random(name)
    context = get_context("fork")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        whole = []
        for which in range(2):
            write(path, which)
            whole.append(path.read_bytes())
        for _ in range(count):
            ready = context.Event()
            process = context.Process(target=_write_for_ever, args=(write, path, ready))
            process.start()
            ready.wait()
            time.sleep(rng.uniform(0, 0.03))
            process.kill()
            process.join()
            read(path)
            counts["the old or the new file" if path.read_bytes() in whole else "another file"] += 1
            counts["temporary files left"] += len(list(path.parent.iterdir())) - 1
            write(path, 0)
            counts["left by the next write"] += len(list(path.parent.iterdir())) - 1
    return counts


def full_disk(name: str, count: int) -> dict[str, int]:
    """Write where only part of the file fits; count the outcomes."""
    write, _ = WRITERS[name]
    counts = {"refused, the old file whole": 0, "else": 0}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path, 0)
        old, size = path.read_bytes(), path.stat().st_size
        for i in range(count):
            resource.setrlimit(resource.RLIMIT_FSIZE, (size * i // count, limits[1]))
            try:
                write(path, 1)
                refused = False
            except OutputError as error:
                refused = str(path) in str(error)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            as_before = path.read_bytes() == old and [path] == list(path.parent.iterdir())
            counts["refused, the old file whole" if refused and as_before else "else"] += 1
    return counts


def full_file_system() -> dict[str, int]:
    """Fill pictures in place on a file system that is too small for them, which needs root; count the outcomes."""
    pixels = np.zeros((SIDE, SIDE, 3), np.uint8)
    counts = {"refused, nothing left": 0, "else": 0}
    with tempfile.TemporaryDirectory() as folder:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={pixels.size // 2}", "tmpfs", folder]
        if subprocess.run(mount, capture_output=True, check=False).returncode:
            return {"not tried: it needs root": 1}
        try:
            for name in ("a.tif", "a.npy"):
                process = get_context("fork").Process(target=_fill_in_place, args=(Path(folder) / name, pixels))
                process.start()
                process.join()
                as_promised = process.exitcode == 0 and not os.listdir(folder)
                counts["refused, nothing left" if as_promised else "else"] += 1
        finally:
            subprocess.run(["umount", folder], check=True)
    return counts


def _fill_in_place(path: Path, pixels: Any) -> None:
    try:
        with picture_to_fill(path, pixels.shape, like=Picture(pixels), in_place=True) as out:
            out[...] = 1
    except OutputError:
        sys.exit(0)
    sys.exit("written")


def heed_interrupts() -> None:
    """Restore the default action: background jobs of a shell ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupts(count: int) -> dict[str, int]:
    """Interrupt `rsdeblur demo` at random moments, by three signals; count the outcomes."""
    counts: dict[str, int] = {}
    rng = random.Random(0)
    for _ in range(count):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-P", "-c", "from rsdeblur.cli import main; main()", "demo", "--size", "640x480"]
            process = subprocess.Popen(
                [*command, "-o", folder, "--force"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                preexec_fn=heed_interrupts,
            )
            time.sleep(rng.uniform(0.3, 6.0))
            number = rng.choice(ENDING)
            process.send_signal(number)
            message = process.communicate()[1]
            left = list(Path(folder).rglob("*.part"))
            how = f"{number.name}: exit {process.returncode}" + ", traceback" * ("Traceback" in message)
            how += ", temporary left" * bool(left)
            counts[how] = counts.get(how, 0) + 1
            if process.returncode not in (0, 128 + number):
                print(how, message[-500:])
    return counts


def damaged_wisdom(count: int) -> dict[str, int]:
    """Plan with wisdom that is damaged in random places, each time in a new process; count the exit codes."""
    counts: dict[str, int] = {}
    rng = random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        _plan("measure")
        file = fft.wisdom_file()
        good = file.read_bytes()
        for _ in range(count):
            data = bytearray(good)
            for _ in range(rng.choice((1, 3, 30))):
                data[rng.randrange(len(data))] = rng.choice((rng.randrange(256), ord(")"), ord("("), ord("9"), 0))
            file.write_bytes(data[: rng.choice((len(data), rng.randrange(len(data))))])
            process = get_context("fork").Process(target=_plan_anew)
            process.start()
            process.join()
            counts[f"exit {process.exitcode}"] = counts.get(f"exit {process.exitcode}", 0) + 1
    return counts


def _plan(planning: Planning) -> None:
    image = np.random.default_rng(0).random((60, 70), dtype=np.float32)
    bank = PsfBank.for_picture(np.eye(5)[2:3].T @ np.eye(5)[2:3], image.shape)
    sharp = Deconvolver(bank, image.shape, nsr=1e-6, planning=planning, threads=1).apply(image)
    np.testing.assert_allclose(sharp, image, atol=1e-4)


def _plan_anew() -> None:
    # The parent has loaded its wisdom already.
    fft._recall.cache_clear()
    _plan("estimate")


def two_planners(count: int) -> dict[str, int]:
    """Let two processes measure and store plans at once, without earlier plans; count the outcomes."""
    counts: dict[str, int] = {}
    for _ in range(count):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            pair = [get_context("spawn").Process(target=_plan, args=("measure",)) for _ in range(2)]
            for process in pair:
                process.start()
            for process in pair:
                process.join()
            codes = sorted(process.exitcode or 0 for process in pair)
            files = [path.suffix for path in Path(folder).rglob("*") if path.is_file()]
            how = f"exits {codes}, files {files}"
            counts[how] = counts.get(how, 0) + 1
    return counts


def killed_workers(count: int) -> dict[str, int]:
    """Kill workers of `rsdeblur batch` at random moments; count the outcomes of the pictures.

    An item whose worker was killed twice is reported. Then the batch is started again, until nothing fails.
    """
    counts = dict.fromkeys(("kills", "runs", "items reported", "pictures of other bytes", "pictures lost"), 0)
    rng = random.Random(0)
    with tempfile.TemporaryDirectory() as name:
        folder, sharp = Path(name), Path(name) / "sharp"
        arguments = [*load.write_batch(folder, 60, (300, 400)), "--jobs", "2", "--threads", "1"]
        load.start(folder, *arguments).wait()
        whole = {path.name: path.read_bytes() for path in sharp.glob("*.png")}
        assert len(whole) == 60
        code = 0
        while counts["kills"] < count or code:
            if code == 0:
                shutil.rmtree(sharp)
            with load.start(folder, *arguments) as process:
                while process.poll() is None:
                    time.sleep(rng.uniform(0, 5))
                    workers = load.workers_of(process)
                    if workers and counts["kills"] < count:
                        with contextlib.suppress(ProcessLookupError):
                            os.kill(rng.choice(workers), signal.SIGKILL)
                            counts["kills"] += 1
            code = process.returncode
            items = json.loads((sharp / "batch.json").read_text())["items"]
            counts["runs"] += 1
            counts["items reported"] += sum(item["state"] == "failed" for item in items)
            made = {path.name: path.read_bytes() for path in sharp.glob("*.png")}
            counts["pictures of other bytes"] += sum(made[name] != whole[name] for name in made)
            if code == 0:
                counts["pictures lost"] += len(whole) - len(made)
    return counts


def _write_video(folder: Path) -> list[str]:
    """Write a video of noise, a log and a camera; return the arguments for `video`."""
    import av

    height, width = 60, 80
    with av.open(str(folder / "clip.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for values in np.random.default_rng(0).integers(0, 256, (24, height, width, 3), np.uint8):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(values, format="rgb24")))
        container.mux(stream.encode())
    log = hand_shake(1.2, seed=1)
    np.savetxt(folder / "gyro.csv", np.column_stack([log.t, log.omega]), delimiter=",", header="t,x,y,z", comments="")
    Camera(width, height, 0.9 * width, readout_time=0.01).save(folder / "camera.toml")
    options = ["--duration", "1/60", "--start", "0.1", "--segment", "3", "--jobs", "2", "--threads", "1"]
    return ["video", "clip.mp4", "--gyro", "gyro.csv", "--camera", "camera.toml", *options, "-o", "sharp.mp4"]


def _start(folder: Path, *arguments: str) -> ForkProcess:
    """Start a command of rsdeblur in a fork, whose workers are forks too: imports take seconds, kills hit what follows.

    Like spawned ones, the workers have no files of the command but their pipe.
    """
    for name in ("cli.batch", "cli.video", "pipeline.plan", "video.segments"):
        import_module(f"rsdeblur.{name}")
    process = get_context("fork").Process(target=_command, args=(folder, arguments))
    process.start()
    return process


def _command(folder: Path, arguments: Sequence[str]) -> None:
    os.chdir(folder)
    os.environ.update(load.UNDATED)
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    fork = get_context("fork")
    context = SimpleNamespace(Pipe=fork.Pipe, Process=partial(_worker, fork))
    with mock.patch.object(workers, "get_context", return_value=context):
        cli.main(arguments, prog_name="rsdeblur")


def _worker(context: Any, target: Callable[..., None], args: tuple[Any, ...], daemon: bool) -> ForkProcess:
    process: ForkProcess = context.Process(target=_alone, args=(target, args), daemon=daemon)
    return process


def _alone(serve: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    """Close the locks and the other pipes, which are pairs of sockets, that were inherited."""
    for file in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):
            kind = os.fstat(file).st_mode
            if file > 2 and file != arguments[0].fileno() and (stat.S_ISREG(kind) or stat.S_ISSOCK(kind)):
                os.close(file)
    serve(*arguments)


def _workers(process: ForkProcess) -> list[int]:
    try:
        return [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    except OSError:
        return []


def _random_moment(rng: random.Random, processes: Sequence[ForkProcess], folder: Path) -> None:
    """Wait until there are a random number of new files in a folder, or all processes end; then a random time."""

    def names() -> set[str]:
        return set(os.listdir(folder)) if folder.is_dir() else set()

    before, wanted = names(), rng.randint(0, 4)
    while len(names() - before) < wanted and any(process.is_alive() for process in processes):
        time.sleep(0.01)
    time.sleep(rng.uniform(0, 0.5))


def killed_videos(count: int, seed: int = 0) -> dict[str, int]:
    """Kill workers of `rsdeblur video`, and a few times the command, at random moments; count the outcomes."""
    counts = dict.fromkeys(("workers killed", "commands killed", "runs", "videos", "of other bytes", "files left"), 0)
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder, sharp = Path(name), Path(name) / "sharp.mp4"
        arguments = _write_video(folder)
        _start(folder, *arguments).join()
        whole, files = sharp.read_bytes(), set(os.listdir(folder))
        code = 0
        while counts["workers killed"] < count or code:
            process = _start(folder, *arguments, "--force")
            counts["runs"] += 1
            for _ in range(rng.randint(1, 4) if counts["workers killed"] < count else 0):
                _random_moment(rng, [process], folder / "sharp.mp4.parts")
                while process.is_alive() and not (victims := _workers(process)):
                    time.sleep(0.01)
                if process.is_alive() and rng.random() > 0.1:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(rng.choice(victims), signal.SIGKILL)
                        counts["workers killed"] += 1
                elif process.is_alive():
                    process.kill()
                    counts["commands killed"] += 1
            process.join()
            code = process.exitcode or 0
            # The video of the last whole run stays until the next one is whole.
            counts["of other bytes"] += sharp.read_bytes() != whole
            if code == 0:
                counts["videos"] += 1
                counts["files left"] += len(set(os.listdir(folder)) - files)
    return counts


def shared_folder(count: int, seed: int = 0) -> dict[str, int]:
    """Start two batches into one folder and kill one of them at a random moment; count the outcomes."""
    counts = dict.fromkeys(("pairs", "refused", "killed", "pictures of other bytes", "pictures lost", "files left"), 0)
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder, sharp = Path(name), Path(name) / "sharp"
        arguments = [*load.write_batch(folder, 8), "--jobs", "1", "--threads", "1"]
        _start(folder, *arguments).join()
        whole = {path.name: path.read_bytes() for path in sharp.glob("*.png")}
        files = {path.name for path in sharp.iterdir()}
        for _ in range(count):
            shutil.rmtree(sharp)
            pair = [_start(folder, *arguments)]
            time.sleep(rng.uniform(0, 1))
            pair.append(_start(folder, *arguments))
            _random_moment(rng, pair, sharp)
            # One of a pair may have been refused and have ended.
            rng.choice([process for process in pair if process.is_alive()] or pair).kill()
            for process in pair:
                process.join()
            codes = [process.exitcode for process in pair]
            counts["pairs"] += 1
            counts["refused"] += codes.count(1)
            counts["killed"] += codes.count(-signal.SIGKILL)
            counts["pictures of other bytes"] += _differing(sharp, whole)
            last = _start(folder, *arguments)
            last.join()
            counts["pictures of other bytes"] += _differing(sharp, whole)
            counts["pictures lost"] += len(whole) - len(list(sharp.glob("*.png"))) + (last.exitcode != 0)
            counts["files left"] += len({path.name for path in sharp.iterdir()} - files)
    return counts


def _differing(folder: Path, whole: Mapping[str, bytes]) -> int:
    """Return how many of the pictures in a folder are not as they are undisturbed."""
    return sum(path.read_bytes() != whole[path.name] for path in folder.glob("*.png"))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run all parts and print a line for each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__)
    parser.add_argument(
        "--kills", type=int, default=200, help="kills for each kind of file; other counts in proportion"
    )
    count = parser.parse_args(arguments).kills
    for name in WRITERS:
        print(f"{name}: killed {count} times: {kills(name, count)}", flush=True)
        print(f"{name}: disk full {count // 10} times: {full_disk(name, count // 10)}", flush=True)
    print(f"pictures in place on a full file system: {full_file_system()}", flush=True)
    print(f"damaged wisdom, {5 * count} files: {damaged_wisdom(5 * count)}", flush=True)
    print(f"two planners at once, {count // 20} pairs: {two_planners(count // 20)}", flush=True)
    print(f"workers of a batch killed {count // 10} times: {killed_workers(count // 10)}", flush=True)
    print(f"workers of videos killed {count} times: {killed_videos(count)}", flush=True)
    print(f"two batches into one folder, one killed, {count} times: {shared_folder(count)}", flush=True)
    print(f"interrupted {count // 10} times: {interrupts(count // 10)}", flush=True)


if __name__ == "__main__":
    main()
