"""Six made captures, deblurred in four ways: `python -m docs.figures.truth [--out FOLDER] [--only NAME]`.

Writes a JPEG sheet for each capture and prints the table of docs/truth.md. The scenes are drawn, but for one portrait
from scikit-image. A simulated phone processes each picture: mosaic, noise, denoising, sharpening and JPEG. The
recording is as wrong as those of phones: a clock 2 ms off and a focal length 2 % short.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skimage.data
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from benchmarks.captures import SimulatedCapture, quality
from benchmarks.phone import from_phone
from benchmarks.refine import Depths
from rsdeblur import Camera, Correction, Exposure, GyroLog, RsdeblurError, deblur, hand_shake, scene, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.transfer import from_linear, to_linear

Light = NDArray[np.float32]
WIDTH, HEIGHT = 640, 480
TRUE = Camera(WIDTH, HEIGHT, 700.0, readout_time=0.03)
RECORDED = replace(TRUE, focal_length=0.98 * 700.0, time_offset=0.002)
# The scene goes on beyond the frame, px.
BEYOND = 96
WIDE, HIGH = WIDTH + 2 * BEYOND, HEIGHT + 2 * BEYOND
# Pixels of a drawing along a pixel's edge.
FINE = 2
DETAIL = 300, 200  # px, width and height of what is shown
LINE = 20  # px, height of a caption
QUALITY = 80
# Light of a lamp, where white is 1.
LAMP = 30.0
WORDS = (
    "The log records how the camera turned while the shutter was open. Rows are read one after the other, so that each "
    "row has its own blur. What the sensor clipped is lost, and what moved by itself stays blurred. "
)
# How each picture is made; the last two are those of the command `deblur`, which refines.
WAYS: dict[str, dict[str, Any]] = {
    "global": {"mode": "global", "prior": "wiener"},
    "banded": {"mode": "banded"},
    "default": {"refine": True},
    "best": {"quality": "best", "refine": True},
}


class Made(NamedTuple):
    """A capture to make: scene, motion, time in s, corner of the detail, noise (0 to 2), and drift of far things in px.

    The sitter of the portrait drifts three times as far.
    """

    light: Callable[[], Light]
    log: GyroLog
    duration: float
    corner: tuple[int, int]
    noisy: int
    drift: tuple[float, float] | None = None


def drawing(colour: str) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """Return a picture to draw on, larger than the scene, and its pen."""
    sheet = Image.new("RGB", (FINE * WIDE, FINE * HIGH), colour)
    return sheet, ImageDraw.Draw(sheet)


def light(sheet: Image.Image) -> Light:
    """Return a drawing in linear light, averaged over each pixel."""
    values = to_linear(np.asarray(sheet, np.float32) / 255, "srgb").reshape(HIGH, FINE, WIDE, FINE, 3)
    return values.mean(axis=(1, 3), dtype=np.float32)


def glow(centres: list[tuple[float, float]], radius: float) -> Light:
    """Return the light of round lamps, shape (H, W, 1), with soft edges."""
    y, x = np.mgrid[:HIGH, :WIDE].astype(np.float32)
    away = np.array([np.hypot(x - across, y - down) for across, down in centres])
    total: Light = (LAMP * (radius - away).clip(0, 1) + 0.002 / (0.02 + (away / 200) ** 2)).sum(axis=0)[..., None]
    return total.astype(np.float32)


def street() -> Light:
    """Draw a street at night: dark houses, lit windows, two signs and lamps."""
    random, (sheet, pen) = np.random.default_rng(1), drawing("#10131c")
    left = 0
    while left < FINE * WIDE:
        wide, top = int(random.integers(150, 320)), int(random.integers(120, 420))
        wall = tuple(int(v) for v in random.integers(24, 52, 3))
        pen.rectangle((left, top, left + wide - 6, FINE * 500), wall)
        for y in range(top + 30, FINE * 430, 80):
            for x in range(left + 22, left + wide - 50, 62):
                lit = random.random() < 0.4
                pane = tuple(int(v) for v in random.integers((190, 140, 60), (250, 200, 120))) if lit else (16, 18, 26)
                pen.rectangle((x, y, x + 32, y + 46), pane, "#05060a", 3)
                pen.line((x + 16, y, x + 16, y + 46), "#05060a", 3)
        left += wide
    pen.rectangle((0, FINE * 500, FINE * WIDE, FINE * HIGH), "#1d1c1f")
    for x in range(40, FINE * WIDE, 200):
        pen.rectangle((x, FINE * 560, x + 110, FINE * 560 + 12), "#6f6c62")
    for corner, text, colour in (((520, 905), "HOTEL ROMA", "#f25c4a"), ((1000, 925), "open 24 h", "#5fd0c0")):
        box = pen.textbbox(corner, text, font=ImageFont.load_default(56))
        pen.rectangle((box[0] - 16, box[1] - 12, box[2] + 16, box[3] + 12), "#07070a", colour, 4)
        pen.text(corner, text, colour, ImageFont.load_default(56))
    return light(sheet) + glow([(150.0, 300.0), (690.0, 270.0)], 4)


def page() -> Light:
    """Draw a printed page, from large to fine print."""
    sheet, pen = drawing("#efece2")
    y, words = 30, WORDS.split()
    for size in (64, 48, 38, 32, 28, 24) * 2:
        for first in (0, 9, 19):
            line = " ".join(words[first:] + words[:first])
            pen.text((30, y), line, "#1b1a1e", ImageFont.load_default(size))
            y += round(1.35 * size)
    return light(sheet)


def leaves() -> Light:
    """Draw leaves over each other, with the sky between some of them."""
    random, (sheet, pen) = np.random.default_rng(2), drawing("#c9dcec")
    for share in np.linspace(0, 1, 5000):
        x, y = random.uniform(0, FINE * WIDE), random.uniform(0, FINE * HIGH)
        length, turn = random.uniform(12, 60) * (1.4 - 0.7 * share), random.uniform(0, 2 * np.pi)
        along = np.linspace(-1, 1, 9)
        half = 0.32 * (1 - along**2)
        outline = np.array([*zip(along, half, strict=True), *zip(along[::-1], -half[::-1], strict=True)])
        turned = length * outline @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]] + (x, y)
        shade = (0.25 + 0.75 * share) * random.uniform(0.6, 1.1)
        green = tuple(int(shade * v) for v in (random.uniform(60, 150), random.uniform(110, 190), 45))
        pen.polygon([tuple(point) for point in turned], green)
        pen.line([tuple(turned[0]), tuple(turned[8])], tuple(int(1.2 * v) for v in green), 2)
    return light(sheet)


def sitter() -> Light:
    """Return the share of the person in the frame of the portrait, shape (HEIGHT, WIDTH, 1), with a soft border."""
    outline = (
        *((155, 75), (170, 35), (225, 15), (280, 35), (302, 90), (275, 125), (260, 175), (300, 215), (305, 260)),
        *((345, 280), (362, 350), (430, 350), (490, 400), (505, 512), (20, 512), (25, 360), (60, 250), (120, 190)),
        *((165, 150), (180, 130), (155, 100)),
    )
    mask = Image.new("L", (WIDTH, WIDTH))
    ImageDraw.Draw(mask).polygon([(x * WIDTH / 512, y * WIDTH / 512) for x, y in outline], 255)
    return np.asarray(mask.filter(ImageFilter.GaussianBlur(4)), np.float32)[:HEIGHT, :, None] / 255


def face() -> Light:
    """Return scikit-image's photograph of Eileen Collins (NASA, public domain), without its bottom."""
    picture = Image.fromarray(skimage.data.astronaut()).resize((WIDTH, WIDTH), Image.Resampling.BICUBIC)
    return to_linear(np.asarray(picture, np.float32)[:HEIGHT] / 255, "srgb")


def shelf() -> Light:
    """Return the simulator's bookcase."""
    return scene(HIGH, WIDE, seed=2)


def lamps() -> Light:
    """Return the bookcase in dim light, with lamps far brighter than white."""
    return 0.35 * scene(HIGH, WIDE, seed=4) + glow([(250.0, 190.0), (430.0, 330.0), (600.0, 200.0)], 7)


def panned(rate: float) -> GyroLog:
    """Return the log of a hand that turns the camera to the right at `rate`, rad/s."""
    shake = hand_shake(0.6, strength=0.2, seed=6)
    return GyroLog(shake.t, shake.omega + np.array([0.0, rate, 0.0]))


def captures() -> dict[str, Made]:
    """Return the captures by the names of their files."""
    return {
        "street": Made(street, hand_shake(0.6, strength=0.25, seed=5), 1 / 10, (150, 260), 2),
        "text": Made(page, hand_shake(0.6, strength=0.4, seed=3), 1 / 20, (60, 60), 1),
        "leaves": Made(leaves, hand_shake(0.6, strength=0.4, seed=4), 1 / 20, (170, 140), 0),
        "portrait": Made(face, hand_shake(0.6, strength=0.15, seed=2), 1 / 15, (150, 20), 1, (3.0, 1.5)),
        "pan": Made(shelf, panned(2.2), 1 / 20, (170, 120), 1),
        "lamps": Made(lamps, hand_shake(0.6, strength=0.4, seed=7), 1 / 15, (130, 90), 1),
    }


def taken(name: str, made: Made) -> SimulatedCapture:
    """Return a capture with the pictures that a phone stores and the recording as it writes it."""
    exposure = Exposure(0.25, made.duration)
    if made.drift is None:
        pictures = simulate(made.light(), made.log, TRUE, exposure)
    else:
        drift = Correction(drift_x=made.drift[0], drift_y=made.drift[1])
        true = Recording(made.log, TRUE, exposure)
        pictures = Depths(name, made.light(), true, 0, drift, 3.0, sitter()).simulation
    return from_phone(SimulatedCapture(name, made.log, RECORDED, exposure, pictures), made.noisy)


def results(capture: SimulatedCapture) -> Iterator[tuple[str, str, Light]]:
    """Yield the name, verdict and picture of each way, in linear light; no picture where rsdeblur refuses."""
    blurred, truth = capture.pictures.blurred, capture.pictures.rolling
    yield "blurred", f"{quality(truth, blurred)[0]:.1f} dB", blurred
    for name, way in WAYS.items():
        try:
            result = deblur(blurred, *capture.recording, **way)
        except RsdeblurError as error:
            yield name, f"refused: {error}", blurred
            continue
        assert result.check is not None
        yield name, f"{quality(truth, result.image)[0]:.1f} dB, {result.check.verdict}", result.image
    yield "truth", "", truth


def main() -> None:
    """Write the sheets and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "truth", help="folder of the sheets")
    parser.add_argument("--only", metavar="NAME", help="one capture")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    print("| capture | blurred | " + " | ".join(WAYS) + " |\n|" + "---|" * (len(WAYS) + 2))
    for name, made in captures().items():
        if options.only not in (None, name):
            continue
        sheet = Image.new("RGB", (3 * DETAIL[0] + 8, 2 * (DETAIL[1] + LINE)), "white")
        pen, font, cells = ImageDraw.Draw(sheet), ImageFont.load_default(14), []
        for n, (way, verdict, picture) in enumerate(results(taken(name, made))):
            (x, y), left, top = made.corner, n % 3 * (DETAIL[0] + 4), n // 3 * (DETAIL[1] + LINE)
            shown = from_linear(picture[y : y + DETAIL[1], x : x + DETAIL[0]].clip(0, 1), "srgb")
            sheet.paste(Image.fromarray(np.rint(255 * shown).astype(np.uint8)), (left, top + LINE))
            pen.text((left + 2, top + 2), f"{way}: {verdict}" if verdict else way, "black", font)
            cells += [verdict] if verdict else []
        sheet.save(options.out / f"{name}.jpg", quality=QUALITY, optimize=True)
        print(f"| [{name}](#{name}) | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
