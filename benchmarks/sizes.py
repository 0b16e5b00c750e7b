"""Odd sizes in all modes and priors: right, or refused clearly. ``python -m benchmarks.sizes [--panorama]``."""

from __future__ import annotations

import argparse
import itertools
import time
import warnings
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, GyroLog, deblur
from rsdeblur.choices import MODES, PRIORS
from rsdeblur.errors import InputError

# (height, width)
SIZES = [
    *((1, 1), (1, 2), (2, 1), (1, 3), (3, 1), (2, 2), (3, 3), (1, 31), (31, 1), (1, 1021), (1021, 1)),
    *((5, 3), (13, 17), (31, 29), (64, 3), (3, 64), (127, 61), (128, 128)),
]
PANORAMA = (300, 20_000)
# Length of the blur as a share of the shorter side of the picture; None: the camera is still.
BLURS = (None, 0.02, 0.3)
PICTURES = ("black", "even", "noise", "noise of 8 bits", "even of 16 bits")
EXPOSURE = Exposure(0.05, 0.02)
# Largest error of values in [0, 1] where the answer is known: the camera is still, or the picture is even. Rounding to
# 8 bits adds half a level.
TOLERANCE = 1e-3


def _picture(kind: str, size: tuple[int, int]) -> NDArray[Any]:
    noise = np.random.default_rng(0).random((*size, 3), dtype=np.float32)
    if kind == "noise of 8 bits":
        return (255 * noise).astype(np.uint8)
    if kind == "even of 16 bits":
        return np.full((*size, 3), 30_000, np.uint16)
    return {"black": np.zeros_like(noise), "even": np.full_like(noise, 0.4), "noise": noise}[kind]


def _outcome(size: tuple[int, int], mode: Any, prior: Any, blur: float | None, kind: str) -> str:
    height, width = size
    focal_length = 10.0 * max(size)
    rate = 0.0 if blur is None else blur * min(size) / focal_length / EXPOSURE.duration
    rates = np.tile([rate, -rate, 0.3 * rate], (40, 1))
    log = GyroLog(0.005 * np.arange(40.0), rates)
    stored = _picture(kind, size)
    try:
        sharp = deblur(
            stored,
            log,
            Camera(width, height, focal_length, readout_time=0.02),
            EXPOSURE,
            mode=mode,
            prior=prior,
            nsr=0.01,
            saturation="ignore",
        ).image
    except InputError as error:
        return f"refused, sides from {min(size)} px" if "picture" in str(error) else f"REFUSED: {error}"
    if sharp.shape != stored.shape or not np.isfinite(sharp).all():
        return "WRONG: not finite or of another shape"
    if kind.startswith("noise") and (blur is not None or prior != "wiener"):
        return "solved, finite"
    full = np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1
    error_of = float(np.abs(sharp - stored / np.float32(full)).max())
    return "solved, right" if error_of < TOLERANCE else f"WRONG by {error_of:.2g}"


def main() -> None:
    """Try all combinations and print how often each outcome occurred."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sizes", description=__doc__)
    parser.add_argument("--panorama", action="store_true", help="20000x300 px instead of the small sizes")
    panorama = parser.parse_args().panorama
    warnings.simplefilter("error")
    sizes = [PANORAMA] if panorama else SIZES
    kinds = ("noise of 8 bits", "even") if panorama else PICTURES
    ends: Counter[str] = Counter()
    for case in itertools.product(sizes, MODES, PRIORS, BLURS[:2] if panorama else BLURS, kinds):
        begin = time.perf_counter()
        end = _outcome(*case)
        ends[end] += 1
        if panorama or end.isupper() or end.startswith(("WRONG", "REFUSED:")):
            print(*case, end, f"{time.perf_counter() - begin:.1f} s", flush=True)
    for end, count in sorted(ends.items()):
        print(f"{count:6} {end}")


if __name__ == "__main__":
    main()
