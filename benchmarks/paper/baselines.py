"""Figures 3 to 5: the Wiener filter compared with TV-L1, other methods and a blind method."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.signal import fftconvolve

from benchmarks import baselines, data
from benchmarks.captures import quality
from benchmarks.data import Image
from benchmarks.paper.figure import Cell, Figure, pictures
from rsdeblur import Camera, Deconvolver, Exposure, GyroLog, PsfBank, deblur, psfs, simulate
from rsdeblur.image.transfer import from_linear
from rsdeblur.motion import BlurPaths
from rsdeblur.motion.paths import Capture

# Figure, picture, start in the log (s), exposure (s), width and height of the PSF in the paper (px).
CASES = (
    ("fig3", "kodim05", 14.0, 1 / 7, (16, 59)),
    ("fig4", "kodim23", 33.0, 1 / 9, (21, 28)),
    ("fig5", "kodim13", 40.0, 1 / 2, (72, 76)),
)
SIZE = 640, 448
READOUT = 0.03
NOISE = 0.01
NSR = 0.01
# Weights of the total variation, from little noise to much.
WEIGHTS = (0.005, 0.02, 0.05)
# Part of the picture that is drawn, px.
SHOWN = np.s_[150:300, 200:400]
WIENER, BANDED, TV, BLIND = "Wiener, global", "Wiener, banded", "TV-L1", "blind + Wiener"


def figures(quick: bool) -> Iterator[Figure]:
    """Yield figures 3 to 5."""
    for case in CASES[:1] if quick else CASES:
        yield figure(*case)


def figure(name: str, picture: str, start: float, duration: float, box: tuple[int, int]) -> Figure:
    """Compare all methods on blur by one PSF, as in the published model, and on a capture."""
    camera, exposure, log = scaled(start, duration, box)
    bank = psfs(log, camera, exposure, mode="global", motion="small-angle")
    sharp = data.light(picture)
    sharp = sharp.mean(axis=2, keepdims=True)
    left, top = (sharp.shape[1] - SIZE[0]) // 2, (sharp.shape[0] - SIZE[1]) // 2
    truth = sharp[top : top + SIZE[1], left : left + SIZE[0]]
    capture = simulate(sharp, log, camera, exposure, noise=NOISE)
    scenes = {"model": (convolved(sharp, bank, top, left), truth), "capture": (capture.blurred, capture.rolling)}
    scores: dict[str, list[Cell]] = {}
    shown: dict[str, Image] = {}
    for kind, (blurred, reference) in scenes.items():
        for method, run in methods(blurred, bank, (log, camera, exposure)).items():
            begin = time.process_time()
            images = run()
            seconds = (time.process_time() - begin) / len(images)
            image = max(images, key=lambda found: quality(reference, found)[0])
            psnr, ssim = quality(reference, image) if method != BLIND else shifted_quality(reference, image)
            scores.setdefault(method, []).extend([psnr, ssim, seconds])
            if kind == "capture":
                shown[f"{method}\n{psnr:.1f} dB"] = from_linear(image.clip(0, 1), "srgb")[SHOWN][..., 0]
    tall, wide = extent(bank)
    return Figure(
        name,
        f"Figure {name[3:]}: exposure of 1/{round(1 / duration)} s, PSF of {wide}x{tall} px",
        f"{data.named(picture)}, a {data.REAL} phone's shake scaled until the PSF has the size in the paper "
        f"({box[0]}x{box[1]} px), "
        f"{SIZE[0]}x{SIZE[1]} px, noise of 40 dB, Phi = {NSR}. *Model*: blurred with the PSF that the methods get. "
        f"*Capture*: simulated with rolling shutter ({1e3 * READOUT:g} ms) and roll, which one PSF cannot describe. "
        f"TV-L1 with the best of the weights {', '.join(map(str, WEIGHTS))}, chosen with the truth; its processor time "
        "is that of one weight. PSNR (dB) and SSIM in sRGB. The picture shows the capture.",
        sentence(scores),
        ("method", "model PSNR", "model SSIM", "model s", "capture PSNR", "capture SSIM", "capture s"),
        [(method, *cells) for method, cells in scores.items()],
        pictures(shown),
    )


def sentence(scores: dict[str, list[Cell]]) -> str:
    """Return whether TV-L1 loses on captures what it gains on the model, and whether the blind method fails."""
    gain = {kind: float(scores[TV][k]) - float(scores[WIENER][k]) for kind, k in (("model", 0), ("capture", 3))}
    blind = float(scores[BLIND][3]) - float(scores["blurred"][3])
    verdict = (
        "Holds" if gain["capture"] < 0 else "Holds in part" if gain["capture"] < gain["model"] else "Does not hold"
    )
    fails = "fails, as theirs did" if blind < 0 else "does not fail here"
    return (
        f"{verdict}: compared with the Wiener filter, TV-L1 is {gain['model']:+.1f} dB with the exact PSF and "
        f"{gain['capture']:+.1f} dB on the capture; the blind method {fails} ({blind:+.1f} dB compared with the "
        "blurred picture)."
    )


def methods(
    blurred: Image, bank: PsfBank, capture: tuple[GyroLog, Camera, Exposure]
) -> dict[str, Callable[[], list[Image]]]:
    """Return the methods, each as a function that deblurs `blurred`."""
    kernel = bank.kernels[0, 0]

    def wiener(psf: Image) -> Image:
        return Deconvolver(PsfBank.for_picture(psf, blurred.shape), blurred.shape, nsr=NSR).apply(blurred)

    size = max(extent(bank)) // 2 * 2 + 5
    return {
        "blurred": lambda: [blurred],
        WIENER: lambda: [wiener(kernel)],
        BANDED: lambda: [deblur(blurred, *capture, nsr=NSR, prior="wiener").image],
        "Wiener, rowwise": lambda: [deblur(blurred, *capture, nsr=NSR, mode="rowwise", prior="wiener").image],
        TV: lambda: [baselines.tv_l1(blurred, kernel, weight=weight) for weight in WEIGHTS],
        "Richardson-Lucy": lambda: [baselines.richardson_lucy(blurred, kernel)],
        "unsupervised Wiener": lambda: [baselines.unsupervised_wiener(blurred, kernel)],
        BLIND: lambda: [wiener(baselines.estimate_psf(blurred, size))],
    }


def scaled(start: float, duration: float, box: tuple[int, int]) -> tuple[Camera, Exposure, GyroLog]:
    """Return a camera, an exposure and a real log whose rates are scaled until the PSF fills the box."""
    log = data.shake()
    camera = Camera(*SIZE, 1.1 * SIZE[0], readout_time=READOUT)
    exposure = Exposure(start, duration, log.epoch_ns)
    scale = np.ones(2)
    for _ in range(6):  # nearly linear in the rates
        shaken = GyroLog(log.t, log.omega * (*scale[::-1], scale.mean()), log.epoch_ns)
        recording = Capture.from_log(shaken, camera, exposure, motion="small-angle")
        d = BlurPaths.from_capture(recording, [(SIZE[1] - 1) / 2], [(SIZE[0] - 1) / 2]).displacements
        scale *= (np.array(box) - 1) / np.ptp(d.reshape(-1, 2), axis=0)
    return camera, exposure, shaken


def extent(bank: PsfBank) -> tuple[int, int]:
    """Return height and width of the part of the first kernel that is not empty."""
    seen = np.argwhere(bank.kernels[0, 0] > 1e-3 * bank.kernels[0, 0].max())
    tall, wide = np.ptp(seen, axis=0) + 1
    return int(tall), int(wide)


def convolved(sharp: Image, bank: PsfBank, top: int, left: int) -> Image:
    """Return the frame, blurred with one PSF of a scene that continues beyond it."""
    tall, wide = (n // 2 for n in bank.size)
    padded = np.pad(sharp[..., 0], ((tall, tall), (wide, wide)), mode="symmetric")
    blurred = fftconvolve(padded, bank.kernels[0, 0], mode="valid")[top : top + SIZE[1], left : left + SIZE[0], None]
    noise = np.random.default_rng(0).normal(0, NOISE, blurred.shape)
    return np.asarray(blurred + noise, dtype=np.float32)


def shifted_quality(truth: Image, image: Image, reach: int = 6) -> tuple[float, float]:
    """Return PSNR and SSIM at the best whole-pixel shift, because a blind estimate has no origin."""
    shifts = [(dy, dx) for dy in range(-reach, reach + 1) for dx in range(-reach, reach + 1)]
    errors = [float(np.square(np.roll(image, shift, (0, 1)) - truth).mean()) for shift in shifts]
    return quality(truth, np.roll(image, shifts[int(np.argmin(errors))], (0, 1)))
