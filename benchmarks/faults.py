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
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import load
from rsdeblur import Camera, Deconvolver, PsfBank
from rsdeblur._util.atomic import atomic_write, remove_unfinished
from rsdeblur.choices import Planning
from rsdeblur.deconv import fft
from rsdeblur.errors import OutputError
from rsdeblur.io import read_picture, write_picture
from rsdeblur.io.picture_output import picture_to_fill
from rsdeblur.io.pictures import Picture

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
    counts = {"the old or the new file": 0, "another file": 0, "temporary files left": 0}
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
            remove_unfinished(path)
            assert list(path.parent.iterdir()) == [path]
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
            number = rng.choice((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
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
    print(f"interrupted {count // 10} times: {interrupts(count // 10)}", flush=True)


if __name__ == "__main__":
    main()
