"""Borders: how the default and its alternatives continue a picture beyond the frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.signal import fftconvolve

from benchmarks import data
from benchmarks.data import Image
from benchmarks.paper.continuations import reflected, smooth, tapered
from benchmarks.paper.figure import Cell, Figure, pictures
from rsdeblur import Camera, Deconvolver, Exposure, PsfBank, psfs
from rsdeblur.choices import Border
from rsdeblur.deconv.rowwise import RowDeconvolver
from rsdeblur.deconv.tiling import fade
from rsdeblur.deconv.unknown_border import extended_shape
from rsdeblur.image.transfer import from_linear
from rsdeblur.motion import BlurPaths, Capture

PICTURES = ("kodim01", "kodim05", "kodim13", "kodim23")
STARTS = (14.0, 33.0, 40.0)
DURATION = 1 / 10
NSR, NOISE = 0.01, 0.005
CAMERA = Camera(512, 384, 560.0)  # no readout time, so that only the border differs
ROUNDS = 5
INSIDE = "paper (blended inside)"
SHOWN = np.s_[:150, :200]


def figures(quick: bool) -> Iterator[Figure]:
    """Yield the comparison."""
    log = data.shake()
    scores: dict[str, list[tuple[float, ...]]] = {}
    shown: dict[str, Image] = {}
    for n, name in enumerate(PICTURES[:1] if quick else PICTURES):
        scene = data.light(name)
        for start in STARTS[:1] if quick else STARTS:
            exposure = Exposure(start, DURATION, log.epoch_ns)
            bank = psfs(log, CAMERA, exposure, mode="global", motion="small-angle")
            paths = BlurPaths.every_row(Capture.from_log(log, CAMERA, exposure, motion="small-angle"), bank.cols)
            for way, score, image in compared(scene, bank, paths):
                scores.setdefault(way, []).append(score)
                if n > 0 or start != STARTS[0]:
                    continue
                shown.setdefault(
                    f"{way}\n{score[1]:.1f} dB near the border", from_linear(image.clip(0, 1), "srgb")[SHOWN]
                )
    means = {way: tuple(map(float, np.mean(found, axis=0))) for way, found in scores.items()}
    yield report(means, shown)


def report(means: dict[str, tuple[float, ...]], shown: dict[str, Image]) -> Figure:
    """Return the figure, and name the best border."""
    tiles = {way: found for way, found in means.items() if not way.startswith(("rowwise", "scene"))}
    best = max(tiles, key=lambda way: tiles[way][1])
    blend, inside = tiles["blend"], tiles[INSIDE]
    rows: list[tuple[Cell, ...]] = [(way, *found) for way, found in means.items()]
    return Figure(
        "borders",
        "Borders: the default and its alternatives",
        f"{data.COLLECTION} pictures cut to {CAMERA.width}x{CAMERA.height} px that go on beyond the frame, blurred "
        f"with one PSF of a {data.REAL} log (1/{round(1 / DURATION)} s, {len(STARTS)} moments, no rolling shutter), "
        f"noise of 46 dB, Wiener filter with Phi = {NSR}. *Near* is within one PSF of the frame, *inside* the rest; "
        "PSNR (dB) in sRGB. "
        "*Ringing* is the root mean square difference, near the border, from the result of the same filter on the "
        "scene beyond the frame, in 1/1000 of the range of sRGB; the last row is that ideal. ms: median processor time "
        "of one application, including the continuation.",
        f"{'Holds' if blend[1] >= inside[1] else 'Holds in part'}: blending opposite borders works, and as the paper "
        f"does it, inside the picture, it reaches {inside[1]:.2f} dB near the border; blending only the continuation, "
        f"our default, {blend[1]:.2f} dB; the best for tiles is {best} with {tiles[best][1]:.2f} dB; no continuation "
        f"(periodic) {tiles['periodic'][1]:.2f} dB.",
        ("border", "ringing", "near (dB)", "inside (dB)", "ms"),
        rows,
        pictures({way: image.mean(axis=2) for way, image in shown.items()}),
    )


def compared(scene: Image, bank: PsfBank, paths: BlurPaths) -> Iterator[tuple[str, tuple[float, ...], Image]]:
    """Deblur one picture in every way: name, (ringing, near, inside, ms), result."""
    tall, wide = bank.size
    top, left = (scene.shape[0] - CAMERA.height) // 2, (scene.shape[1] - CAMERA.width) // 2
    frame = np.s_[top : top + CAMERA.height, left : left + CAMERA.width]
    around = np.pad(scene, ((tall // 2, tall // 2), (wide // 2, wide // 2), (0, 0)), mode="symmetric")
    blurred = fftconvolve(around, bank.kernels[0, 0][..., None], mode="valid", axes=(0, 1))
    blurred = (blurred + np.random.default_rng(0).normal(0, NOISE, blurred.shape)).astype(np.float32)
    observed = np.ascontiguousarray(blurred[frame])
    whole = Deconvolver(PsfBank.for_picture(bank.kernels[0, 0], scene.shape), scene.shape, nsr=NSR)
    ideal = whole.apply(blurred)[frame]
    near = np.ones((CAMERA.height, CAMERA.width), dtype=np.bool_)
    near[tall:-tall, wide:-wide] = False
    truth, reference = (from_linear(light.clip(0, 1), "srgb") for light in (scene[frame], ideal))
    ways = {**solvers(observed, bank), "rowwise": rowwise(observed, paths), "scene beyond the frame": lambda: ideal}
    for name, run in ways.items():
        result, seconds = timed(run)
        image = from_linear(result.clip(0, 1), "srgb")
        ringing = 1e3 * float(np.sqrt(np.square(image - reference)[near].mean()))
        decibels = (-10 * np.log10(np.square(image - truth)[part].mean()) for part in (near, ~near))
        yield name, (ringing, *map(float, decibels), 1e3 * seconds), result


def solvers(observed: Image, bank: PsfBank) -> dict[str, Callable[[], Image]]:
    """Return a function for each border of tiles that solves the picture."""

    def planned(border: Border, prepare: Callable[[], Image]) -> Callable[[], Image]:
        shape = prepare().shape
        kernel = bank.kernels[0, 0]
        filters = Deconvolver(PsfBank.for_picture(kernel, shape), shape, nsr=NSR, border=border)
        return lambda: filters.apply(prepare())[: CAMERA.height, : CAMERA.width]

    height, width, _ = extended_shape(observed.shape, bank)
    alternatives: dict[str, Callable[[], Image]] = {
        "reflect": lambda: reflected(observed, height, width),
        "edge-taper": lambda: tapered(observed, bank.kernels[0, 0]),
        "smooth": lambda: smooth(observed, height, width),
    }
    return {
        "blend": planned("blend", lambda: observed),
        "periodic": planned("periodic", lambda: observed),
        **{name: planned("periodic", prepare) for name, prepare in alternatives.items()},
        INSIDE: planned("periodic", lambda: blended_inside(observed, bank.size)),
    }


def rowwise(observed: Image, paths: BlurPaths) -> Callable[[], Image]:
    """Return a function for the exact solve, in which rows beyond the frame are unknowns."""
    solver = RowDeconvolver(paths, observed.shape, nsr=NSR)
    return lambda: solver.apply(observed)


def blended_inside(light: Image, size: tuple[int, int]) -> Image:
    """Blend opposite borders over half a PSF on either side, as the paper does."""
    for axis, kernel in enumerate(size):
        light = np.moveaxis(light, axis, 0)
        reach = kernel // 2
        share = fade(2 * reach)[reach:, None, None]  # a half and more: at the seam both ends are the mean of both
        ends = light[-reach:], light[:reach]
        inner = light[reach:-reach]
        start = share * ends[1] + (1 - share) * ends[0][::-1]
        end = share[::-1] * ends[0] + (1 - share[::-1]) * ends[1][::-1]
        light = np.moveaxis(np.concatenate([start, inner, end]), 0, axis)
    return np.ascontiguousarray(light, dtype=np.float32)


def timed(run: Callable[[], Image]) -> tuple[Image, float]:
    """Return the result and the median processor time of some runs."""
    seconds = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        result = run()
        seconds.append(time.process_time() - begin)
    return result, float(np.median(seconds))
