"""The machine and the versions that a benchmark ran on."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rsdeblur import config

# Load above which other processes disturb the times.
BUSY = 0.5
# Time over which the load is measured, s.
SPAN = 5.0
PEERS = ("scikit-image", "opencv-python-headless", "mkl_fft", "mkl", "regularizepsf")


def facts() -> dict[str, str]:
    """Return processor, caches, memory, system and versions."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "caches": _caches(),
        "memory": _memory(),
        "system": f"{platform.system()} {platform.machine()}",
        **config.facts(),
        **{name: _version(name) for name in PEERS},
    }


def load() -> float:
    """Return how many processors other processes keep busy, measured for 5 s.

    The load average of the system would contain this process's own past. It serves without Linux's `/proc`, and 0
    where there is none.
    """
    before = _busy_seconds()
    if before is None:
        return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    time.sleep(SPAN)
    return ((_busy_seconds() or before) - before) / SPAN


def busy(load: float) -> list[str]:
    """Return a warning if other processes were running when the benchmark began."""
    if load <= BUSY:
        return []
    return [f"The machine was busy (load {load:.1f}), so figures for several threads mean little."]


def stolen() -> float:
    """Return the time that the host of this virtual machine has given to others while this one had work, s.

    It is 0 without Linux's `/proc`, and where the host does not tell.
    """
    seconds = _processor_seconds()
    return 0.0 if seconds is None else seconds[-1]


def _busy_seconds() -> float | None:
    """Return the time that all processors have worked, here or for other guests, s; None without `/proc`."""
    seconds = _processor_seconds()
    return None if seconds is None else sum(seconds) - sum(seconds[3:5])


def _processor_seconds() -> list[float] | None:
    """Return the seconds of user, nice, system, idle, iowait, irq, softirq, steal of all processors, if known."""
    try:
        first = Path("/proc/stat").read_text().split("\n", 1)[0]
    except OSError:
        return None
    # proc(5); the guests' times are part of user and nice.
    return [int(number) / os.sysconf("SC_CLK_TCK") for number in first.split()[1:9]]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"


def _caches() -> str:
    caches = []
    for folder in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, kind, size = ((folder / name).read_text().strip() for name in ("level", "type", "size"))
        if kind != "Instruction":
            caches.append(f"L{level} {size}")
    return ", ".join(caches) or "unknown"


def _memory() -> str:
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return "unknown"
    return f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
