"""Fixtures shared by all tests."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest

from rsdeblur.motion.gyro import GyroLog
from rsdeblur.simulation import scene as scenes
from rsdeblur.simulation.shake import hand_shake
from rsdeblur.types import FloatImage

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
# Containers have no sandbox for the browser, and nothing here needs a GPU or the network.
BROWSER_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
]
# A shell that starts the tests in the background ignores Ctrl-C and nohup ignores SIGHUP, for them and for the commands
# that they interrupt.
DEFAULTS = {"SIGINT": signal.default_int_handler, "SIGHUP": signal.SIG_DFL}
if threading.current_thread() is threading.main_thread():
    for name, handler in DEFAULTS.items():
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
# Tests start Python processes from the repository root, where the bare source folder must not shadow the installation.
os.environ["PYTHONSAFEPATH"] = "1"
# Tests and benchmarks are not part of the installed package; last, for the same reason.
sys.path.append(str(Path(__file__).resolve().parents[1]))

from tests.installed import needs  # noqa: E402 (found by the path above)

# The first process compiles every kernel while the second one tests what needs few; then come the longest files, so
# that all processes end together.
FIRST = (
    *("kernels/test_twins.py", "test_faults.py", "io", "test_hostile_input.py", "test_build.py", "cli", "app"),
    *("test_docs.py", "estimate", "burst", "calibration", "pipeline", "simulation"),
)


def _drawn_once(draw: Callable[..., FloatImage]) -> Callable[..., FloatImage]:
    """Return `draw` with a memory: to draw a scene takes half a second, and many tests take the same scenes."""
    remembered = functools.cache(draw)

    @functools.wraps(draw)
    def scene(*size: Any, **options: Any) -> FloatImage:
        if {type(value) for value in (*size, *options.values())} != {int}:
            return draw(*size, **options)
        return remembered(*size, **options).copy()

    return scene


scenes.scene = _drawn_once(scenes.scene)


@functools.cache
def _place(path: Path) -> int:
    parts = path.relative_to(Path(__file__).parent)
    return next((n for n, name in enumerate(FIRST) if parts.is_relative_to(name)), len(FIRST))


def pytest_configure() -> None:
    """Give each of several processes a processor: else the threads of all would get into each other's way."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is not None and hasattr(os, "sched_setaffinity"):
        processors = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {processors[int(worker.removeprefix("gw")) % len(processors)]})


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--except-passed", metavar="JUNIT.xml", help="leave out what passed in the run of this report")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order the files, and leave out what passed in an earlier run; what it skipped, or did not have, stays."""
    items.sort(key=lambda item: _place(item.path))
    report = config.getoption("--except-passed")
    if report is None:
        return
    cases = ElementTree.parse(report).iter("testcase")
    passed = {(case.get("classname"), case.get("name")) for case in cases if len(case) == 0}

    def name(item: pytest.Item) -> tuple[str, str]:
        address, bracket, parameters = item.nodeid.partition("[")
        path, *names = address.split("::")
        return ".".join([path.removesuffix(".py").replace("/", "."), *names[:-1]]), names[-1] + bracket + parameters

    config.hook.pytest_deselected(items=[item for item in items if name(item) in passed])
    items[:] = [item for item in items if name(item) not in passed]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Look for no garbage among modules and tests, which stay to the end: that would take seconds in every process."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep measured FFT plans out of the user's cache."""
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real recordings, which are not part of the repository; tests that want it skip without it."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("RSDEBLUR_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set RSDEBLUR_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def shaky_log():
    """Builder of a hand-shake log of 0.4 s at 200 Hz, about 1 rad/s, its rates about x, y, z multiplied by `axes`."""

    def build(axes: tuple[float, float, float] = (1.0, 1.0, 1.0), *, seed: int = 0) -> GyroLog:
        log = hand_shake(0.4, seed=seed)
        return GyroLog(log.t, log.omega * axes)

    return build


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    playwright = needs("browser-test")
    path = os.environ.get("RSDEBLUR_CHROMIUM") or next(filter(None, map(shutil.which, CHROMIUM)), None)
    if path is None:
        pytest.skip("no Chromium found; install one or name it in RSDEBLUR_CHROMIUM")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=BROWSER_FLAGS)
        yield chromium
        chromium.close()
