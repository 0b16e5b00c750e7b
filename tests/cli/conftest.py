"""A small capture as files in a folder, and functions that run commands on it."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib.resources import files as files_of
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from rsdeblur._util import workers
from rsdeblur.cli import main
from rsdeblur.cli._output import COMPILING, SCHEMA
from rsdeblur.estimate.time_offset import OffsetSearch
from rsdeblur.motion.camera import Camera

RECORDS = tomllib.loads(files_of("rsdeblur.cli").joinpath("schema.toml").read_text("utf-8"))
WIDTH, HEIGHT = 96, 72
START, DURATION = 0.2, 0.04
FRAMES = (START, 0.3, 5.0)  # s; the last one lies beyond the log


class Files(NamedTuple):
    """Paths of the photo and what belongs to it."""

    photo: Path
    gyro: Path
    camera: Path
    captures: Path

    @property
    def sources(self) -> list[str]:
        """Options that name the log and the camera."""
        return ["--gyro", str(self.gyro), "--camera", str(self.camera)]

    @property
    def recording(self) -> list[str]:
        """Options that name the log, the camera and the exposure."""
        return [*self.sources, "--start", str(START), "--duration", str(DURATION)]

    def samples(self) -> np.ndarray:
        """Columns t (s), wx, wy, wz (rad/s) of the log."""
        return np.loadtxt(self.gyro, delimiter=",", skiprows=1)

    def write_gyro(self, samples: np.ndarray) -> None:
        """Replace the log."""
        np.savetxt(self.gyro, samples, "%.6f", ",", header="t,wx,wy,wz", comments="")


@pytest.fixture
def files(tmp_path: Path) -> Files:
    """Write a noise picture, half a second of a swinging log, its camera and a capture file."""
    files = Files(*(tmp_path / name for name in ("photo.png", "gyro.csv", "camera.toml", "frames.csv")))
    pixels = np.random.default_rng(0).integers(60, 200, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(files.photo)
    t = np.arange(0.0, 0.5, 0.005)
    files.write_gyro(np.column_stack([t, np.sin(20 * t), 0.8 * np.cos(9 * t), 0.1 + 0 * t]))
    Camera(WIDTH, HEIGHT, 110.0, readout_time=0.03).save(files.camera)
    header = (
        "Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Sensor frame duration[nanosec],"
        "Frame readout time[nanosec],ISO,Focal length,Focus distance,AF mode"
    )
    rows = [f"{round(t * 1e9)},110,110,{i},{round(DURATION * 1e9)},1,1,1,1,1,1" for i, t in enumerate(FRAMES)]
    files.captures.write_text("\n".join([header, *rows]) + "\n")
    return files


def run_command(*arguments: object) -> Result:
    """Run the command line; any exception fails the test, and JSON that is not as `schema.toml` lists it."""
    words = [str(argument) for argument in arguments]
    result = CliRunner().invoke(main, words, catch_exceptions=False)
    # Whichever test comes first after an installation compiles.
    result.stderr_bytes = (result.stderr_bytes or b"").replace(f"rsdeblur: {COMPILING}\n".encode(), b"")
    if "--json" in words and result.stdout:
        found = json.loads(result.stdout)
        assert found.pop("schema") == SCHEMA
        compare(kind_of(words, found), found)
    return result


def kind_of(words: list[str], found: dict[str, Any]) -> str:
    """Return the kind of what a command prints."""
    name = words[0]
    if name == "deblur":
        return "batch" if "items" in found else "deblur --dry-run" if "--dry-run" in words else name
    return "compare" if name == "demo" and "modes" in found else name


def compare(kind: str, found: dict[str, Any]) -> None:
    """Check that a record has all stable keys of its kind."""
    keys = RECORDS[kind]
    assert {name for name in keys if name[-1] != "?"} <= found.keys()
    for name, key in keys.items():
        value = found.get(name.rstrip("?"))
        if isinstance(key, dict) and value is not None:
            ((form, inner),) = key.items()
            for each in [value] if form == "record" else value if form == "list" else value.values():
                compare(inner, each)


@pytest.fixture
def run() -> Callable[..., Result]:
    """Return the function that runs the command line."""
    return run_command


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in this process, which saves the start of workers."""

    def run(work: Any, tasks: Any, **_: object) -> Iterator[Any]:
        for task in tasks:
            yield task, workers.attempt(work, task)

    monkeypatch.setattr(workers, "run", run)


def found_offset(late: float) -> Callable[..., OffsetSearch]:
    """Return a stand-in for the search of an offset, which has its own tests."""

    found = partial(OffsetSearch, late, late, 0.001, 40.0, "", np.zeros(1), np.zeros(1))
    return lambda image, log, camera, exposure, *, search=(0, 0), **_: found(replace(camera, time_offset=late))


@contextmanager
def started(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Start a command in a separate process group; if the test fails, print where the command stands."""
    command = [sys.executable, "-P", "-X", "faulthandler", "-m", "rsdeblur", *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, start_new_session=True) as process:
        try:
            yield process
        except BaseException:
            if process.poll() is None:
                process.send_signal(signal.SIGABRT)
                print(*process.communicate(timeout=10))
            raise
        finally:
            process.kill()


def until(process: subprocess.Popen[str], condition: Callable[[], object]) -> None:
    """Wait until the condition holds; fail if the process ends before."""
    while not condition():
        assert process.poll() is None, process.communicate()
        time.sleep(0.002)


def kill_worker(process: subprocess.Popen[str]) -> None:
    """Wait for the only worker of a command, and kill it."""

    def workers() -> list[int]:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        # multiprocessing starts another process, which is no worker.
        return [int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]

    until(process, workers)
    os.kill(workers()[0], signal.SIGKILL)


class Processes(NamedTuple):
    """The three functions above."""

    started: Callable[..., Any] = started
    until: Callable[..., None] = until
    kill_worker: Callable[..., None] = kill_worker


@pytest.fixture
def processes() -> Processes:
    """Return functions that start commands in separate processes and kill their workers."""
    if not Path("/proc/self/task").exists():
        pytest.skip("needs /proc to find the workers")
    return Processes()
