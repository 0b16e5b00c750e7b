"""What `compare` and `demo` measure: likeness to the truth, and memory."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

# px along the picture's edge that are not judged: what lies there was blurred with what lies outside.
BORDER = 24


def similarity(image: NDArray[Any], truth: NDArray[Any]) -> dict[str, float | None]:
    """Return PSNR in dB and SSIM of display values in [0, 1], borders and alpha left out.

    PSNR is None where both are the same, as JSON has no infinity. SSIM uses the Gaussian window of its authors (Wang
    et al. 2004).
    """
    import numpy as np
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    # A picture too small for the whole border gives up a quarter of its side.
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
    """Start a new measurement of the peak; where the system has none, `peak_memory_mib` says so."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mib() -> float | None:
    """Return the process's peak resident memory in MiB since `forget_peak_memory`, None where it is unknown."""
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    except OSError:
        return None
    return int(found[1]) / 1024 if found else None
