"""Measurements of results: similarity to the truth, memory, and time without that in which Numba compiles."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numba.core.event import TimingListener, install_listener
from numpy.typing import NDArray

# Pixels along the picture's edges that do not count, because light from beyond the frame blurred them.
BORDER = 24


def similarity(image: NDArray[Any], truth: NDArray[Any]) -> dict[str, float | None]:
    """Return PSNR in dB and SSIM of display values in [0, 1], without borders and alpha.

    PSNR is None for equal pictures, because JSON has no infinity. SSIM uses the Gaussian window of its authors (Wang
    et al. 2004).
    """
    import numpy as np
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    # Small pictures lose no more than a quarter of a side at each edge.
    y, x = (min(BORDER, side // 4) for side in image.shape[:2])
    a, b = (values[y : values.shape[0] - y, x : values.shape[1] - x] for values in (image, truth))
    axis = None if a.ndim == 2 else 2
    if axis and a.shape[2] in (2, 4):
        a, b = a[..., :-1], b[..., :-1]
    ssim = structural_similarity(
        a, b, data_range=1.0, channel_axis=axis, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    psnr = None if np.array_equal(a, b) else float(peak_signal_noise_ratio(b, a, data_range=1.0))
    return {"psnr_db": psnr, "ssim": float(ssim)}


def forget_peak_memory() -> None:
    """Start a new measurement of the peak; without effect where the system has no such measurement."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mib() -> float | None:
    """Return the process's peak resident memory in MiB since `forget_peak_memory`, None where it is unknown."""
    try:
        match = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    except OSError:
        return None
    return int(match[1]) / 1024 if match else None


@dataclass(slots=True)
class Stopwatch:
    """Time of a block in s, which is known after it."""

    seconds: float = 0.0


@contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Measure the time of the block without compilation.

    Only the first run after the installation compiles. Numba compiles one function at a time, whatever the thread.
    """
    watch, compiler = Stopwatch(), TimingListener()
    begin = time.perf_counter()
    with install_listener("numba:compile", compiler):
        yield watch
    watch.seconds = time.perf_counter() - begin - (compiler.duration if compiler.done else 0.0)
