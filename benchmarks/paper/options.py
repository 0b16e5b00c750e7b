"""Two options of the authors: Phi from the sensitivity, and normalisation of the range."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks import data
from benchmarks.captures import quality
from benchmarks.data import Image
from benchmarks.paper.figure import Cell, Figure, lines, pictures
from rsdeblur import Camera, Exposure, deblur, simulate
from rsdeblur.image.transfer import from_linear

CAMERA = Camera(640, 448, 704.0)
PICTURES = ("kodim05", "kodim13", "kodim23")
START, DURATION = 33.0, 1 / 15
ISO = (100, 200, 400, 800, 1600)
NOISE = 0.005  # at ISO 100
# A large blur of a bright scene.
BRIGHT, LARGE, GAIN = "kodim20", 1 / 4, 1.3
SHOWN = np.s_[150:350, 250:500]


def figures(quick: bool) -> Iterator[Figure]:
    """Yield a figure for each option."""
    yield sensitivity(PICTURES[:1] if quick else PICTURES)
    yield normalisation()


def sensitivity(names: tuple[str, ...]) -> Figure:
    """Compare Phi fixed, from ISO, and from the picture."""
    log = data.shake()
    recording = log, CAMERA, Exposure(START, DURATION, log.epoch_ns)
    curves: dict[str, list[float]] = {"Phi = 0.01": [], "Phi from ISO": [], "Phi from the picture": []}
    captures = [simulate(data.light(name), *recording) for name in names]
    grain = np.random.default_rng(0).normal(0.0, NOISE, captures[0].blurred.shape).astype(np.float32)
    for iso in ISO:
        scores: dict[str, list[float]] = {way: [] for way in curves}
        for capture in captures:
            noisy = capture.blurred + np.float32((iso / 100) ** 0.5) * grain
            for way, nsr in zip(curves, (0.01, 0.01 * iso / 100, "auto"), strict=True):
                image = deblur(noisy, *recording, mode="global", motion="small-angle", nsr=nsr, prior="wiener").image  # type: ignore[arg-type]  # mypy joins the strengths to object
                scores[way].append(quality(capture.rolling, image)[0])
        for way, values in scores.items():
            curves[way].append(float(np.mean(values)))
    gains = [b - a for a, b in zip(curves["Phi = 0.01"], curves["Phi from ISO"], strict=True)]
    largest = max(gains, key=abs)
    holds = "Holds" if abs(largest) < 0.5 else "Holds in part" if abs(gains[2]) < 0.5 else "Does not hold"
    return Figure(
        "iso",
        "Phi from the sensitivity",
        f"{len(names)} pictures blurred by a {data.REAL} shake (no rolling shutter); the noise's deviation is {NOISE} "
        "at ISO 100 and grows with the root of the sensitivity. Phi is 0.01, proportional to ISO, or derived from the "
        "picture (ours). PSNR, dB.",
        f"{holds}: they found little effect; here Phi from ISO gains {gains[2]:+.1f} dB over 0.01 at ISO 400 and "
        f"{gains[-1]:+.1f} dB at ISO 1600.",
        ("ISO", *curves),
        list(zip(map(str, ISO), *curves.values(), strict=True)),
        lines([float(iso) for iso in ISO], curves, "ISO", "PSNR (dB)", xscale="log"),
    )


def normalisation() -> Figure:
    """Compare plain clipping with the normalised range."""
    log = data.shake()
    recording = log, CAMERA, Exposure(START, LARGE, log.epoch_ns)
    capture = simulate((GAIN * data.light(BRIGHT)).clip(0, 1), *recording, noise=NOISE)
    truth = capture.rolling
    rows: list[tuple[Cell, ...]] = []
    shown: dict[str, Image] = {}
    for label, normalize in (("clipped", False), ("normalised", True)):
        result = deblur(
            capture.blurred,
            *recording,
            mode="global",
            motion="small-angle",
            nsr=0.01,
            normalize=normalize,
            prior="wiener",
        )
        kept = result.image.clip(0, 1)
        lost = float(((kept == 0) | (kept == 1)).mean())
        psnr, ssim = quality(truth, kept)
        rows.append((label, 100 * lost, float(kept.std() / truth.std()), psnr, ssim))
        shown[f"{label}\n{psnr:.1f} dB"] = from_linear(kept, "srgb")[SHOWN].mean(axis=2)
    wide = result.psfs.size
    (clipped, contrast, plain, _), (outliers, squeezed, normalised, _) = (tuple(map(float, row[1:])) for row in rows)
    return Figure(
        "normalisation",
        "Normalisation of the range",
        f"{data.named(BRIGHT)}, {GAIN} times as bright, blurred over 1/{round(1 / LARGE)} s (PSF of "
        f"{wide[1]}x{wide[0]} px), global. *Clipped* values in per cent; *contrast* is the standard deviation of light "
        "divided by that of the truth; PSNR (dB) and SSIM in sRGB.",
        f"Holds{'' if squeezed < contrast else ' in part'}: normalisation clips {outliers:.1f} % instead of "
        f"{clipped:.1f} % and costs contrast ({squeezed:.2f} instead of {contrast:.2f} of the truth); the PSNR goes "
        f"from {plain:.1f} to {normalised:.1f} dB.",
        ("range", "clipped (%)", "contrast", "PSNR", "SSIM"),
        rows,
        pictures(shown),
    )
