"""PSNR on a simulated capture that needs no recordings: a speed-up that lowers it is no speed-up."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.captures import SimulatedCapture, quality, synthetic
from rsdeblur import deblur

METHODS: dict[str, dict[str, Any]] = {
    "global": {"mode": "global"},
    "4 bands": {"bands": 4, "strips": 1},
    "16 bands": {"bands": 16, "strips": 1},
    "auto": {},
}
NSR = 0.03


class Synthetic:
    """A small capture, deblurred by each method."""

    params: ClassVar = list(METHODS)
    param_names = ("method",)

    def setup_cache(self) -> SimulatedCapture:
        """Simulate once for all methods."""
        return synthetic()

    def track_psnr(self, capture: SimulatedCapture, method: str) -> float:
        """Return the PSNR against the true picture, dB."""
        image = deblur(capture.pictures.blurred, *capture.recording, prior="wiener", nsr=NSR, **METHODS[method]).image
        return quality(capture.pictures.rolling, image)[0]

    track_psnr.unit = "dB"  # type: ignore[attr-defined]  # asv reads it from the function
