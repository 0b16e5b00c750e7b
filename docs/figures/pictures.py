"""Pictures of what choices do, from one simulated capture: `python docs/figures/pictures.py`.

Writes JPEG files beside itself, each a row of details with captions. Nothing in them comes from a camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from rsdeblur import Camera, Exposure, GyroLog, deblur, simulate
from rsdeblur.image.transfer import from_linear
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake
from rsdeblur.simulation.simulate import Simulation

HERE = Path(__file__).parent
WIDTH, HEIGHT = 640, 480
CAMERA = Camera(WIDTH, HEIGHT, 700.0, readout_time=0.03)
EXPOSURE = Exposure(0.25, 0.05)
SHAKE = hand_shake(0.6, strength=0.5, seed=3)
MARGIN = 64  # px; the scene goes on beyond the frame, further than the blur reaches
DETAIL = (300, 190)  # px, width and height of what is shown
ENLARGED = 1.4


def strip(name: str, pictures: Mapping[str, np.ndarray], corner: tuple[int, int], columns: int = 2) -> None:
    """Write the same detail of several pictures in linear light, with captions, `columns` beside each other."""
    width, height = (round(ENLARGED * side) for side in DETAIL)
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * (width + 8) - 8, rows * (height + 28)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for i, (caption, light) in enumerate(pictures.items()):
        left, top = (i % columns) * (width + 8), (i // columns) * (height + 28)
        x, y = corner
        shown = from_linear(light[y : y + DETAIL[1], x : x + DETAIL[0]].clip(0.0, 1.0), "srgb")
        picture = Image.fromarray(np.rint(255 * shown).astype(np.uint8)).resize(
            (width, height), Image.Resampling.LANCZOS
        )
        pen.text((left + 2, top + 4), caption, "black", font)
        sheet.paste(picture, (left, top + 26))
    sheet.save(HERE / f"{name}.jpg", quality=85)


def taken(noise: float = 0.005) -> Simulation:
    """Return the capture."""
    return simulate(scene(HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, seed=2), SHAKE, CAMERA, EXPOSURE, noise=noise)


def sharp(blurred: np.ndarray, log: GyroLog = SHAKE, camera: Camera = CAMERA, **how: Any) -> np.ndarray:
    """Return the deblurred picture."""
    return deblur(blurred, log, camera, EXPOSURE, **how).image


def main() -> None:
    """Write all pictures."""
    capture = taken()
    top, bottom = (170, 20), (170, 270)
    blurred = {"blurred": capture.blurred}
    strip("before-after", {"shaken": capture.blurred, "after rsdeblur": sharp(capture.blurred)}, bottom)
    modes = {mode: sharp(capture.blurred, mode=mode, prior="tv") for mode in ("global", "banded", "rowwise")}
    strip("modes", blurred | modes, bottom)
    bands = {f"{n} band{'s' * (n > 1)}": sharp(capture.blurred, bands=n, strips=1, prior="tv") for n in (1, 3, 8)}
    strip("bands", bands | {"auto": sharp(capture.blurred, bands="auto", strips=1, prior="tv")}, bottom)
    strips = {f"{n} strip{'s' * (n > 1)}": sharp(capture.blurred, strips=n, prior="tv") for n in (1, 2)}
    strip("strips", blurred | strips | {"auto": sharp(capture.blurred, prior="tv")}, (330, 20))
    priors = {prior: sharp(capture.blurred, prior=prior) for prior in ("wiener", "gradient", "tv", "hyper-laplacian")}
    strip("priors", priors, bottom)
    auto = deblur(capture.blurred, SHAKE, CAMERA, EXPOSURE, prior="tv")
    assert auto.weight is not None
    weights = {f"weight {k:g} x auto": sharp(capture.blurred, prior="tv", weight=k * auto.weight) for k in (0.1, 1, 10)}
    strip("weights", blurred | weights, bottom)
    mirrored = GyroLog(SHAKE.t, SHAKE.omega * (1, -1, 1))
    quick: dict[str, Any] = {"prior": "tv"}
    symptoms = {
        "all right": sharp(capture.blurred, **quick),
        "clock 5 ms off": sharp(capture.blurred, log=SHAKE.shifted(0.005), **quick),
        "clock 20 ms off": sharp(capture.blurred, log=SHAKE.shifted(0.020), **quick),
        "an axis of the wrong sign": sharp(capture.blurred, log=mirrored, **quick),
        "focal length 15 % short": sharp(
            capture.blurred, camera=Camera(WIDTH, HEIGHT, 595.0, readout_time=0.03), **quick
        ),
        "focal length 15 % long": sharp(
            capture.blurred, camera=Camera(WIDTH, HEIGHT, 805.0, readout_time=0.03), **quick
        ),
        "readout 0 instead of 30 ms": sharp(capture.blurred, camera=Camera(WIDTH, HEIGHT, 700.0), **quick),
        "weight a tenth": sharp(capture.blurred, weight=auto.weight / 10, **quick),
    }
    strip("symptoms", symptoms, top)


if __name__ == "__main__":
    main()
