"""Learn the factors of the wavelet prior: ``python -m benchmarks.train_wavelet``; writes rsdeblur/deconv/wavelet.json.

Crops of sharp pictures are blurred with PSFs of a simulated hand and restored with the solver and the strengths of the
package; the factors minimise the squared error of the sum of the shrunk restorations. They are learned on other
pictures and PSFs than the benchmarks use: `flower_foveon` and `berlin_01` of the folder `sharp` beside the recordings,
and pictures that scikit-image contains.

A case draws the size of the blur, the noise, whether values are light or sRGB (then errors count in sRGB), whether it
is stored as JPEG, and whether the noise is given or estimated. In half of the cases the motion is wrong: up to 3 % too
large or too small, and up to 2 ms early or late. A case has the weight one over the root mean square error of its
middle restoration: without it hard cases would dominate; its square would count gains in dB, and flat pictures would
dominate. Everything is seeded.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import skimage.data
from PIL import Image as Pillow
from rich.progress import track
from scipy.signal import fftconvolve

from benchmarks.captures import DATA, Image, require_data
from benchmarks.priors import jpeg
from rsdeblur import Camera, Exposure, GyroLog, PsfBank, TileQuadratic, Tuning, from_linear, hand_shake, to_linear
from rsdeblur._util.threads import thread_count
from rsdeblur.deconv.wavelet import FACTORS, OPPONENT, hats
from rsdeblur.kernels.frame import GATES, HALO, LEVELS
from rsdeblur.kernels.frame import terms as frame_terms
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.pipeline.steps import LEAST_WAVELET_NSR
from rsdeblur.types import FloatArray

RATIOS = np.array([0.05, 0.4, 3.0])
KNOTS = np.array([-2.25, -1.5, -0.75, 0.0])
SIDE = 192
# Bounds of the draws: noise in units of 255, longest side of the PSF in px, relative error of the motion, its delay in
# s; and the share of the colour pictures in sRGB that are stored as JPEG.
NOISES, SIZES, SIZE_ERROR, DELAY, JPEG_SHARE = (0.5, 14.0), (3.0, 45.0), 0.03, 0.002, 0.4
# Weight of the squared change of a factor from knot to knot, and of its square, relative to the mean diagonal.
SMOOTH, RIDGE = 1e-4, 1e-6
# Factors of one class at one knot: means, and differences of two kinds with each gate.
TERMS = len(RATIOS) * (1 + LEVELS * 2 * (1 + len(GATES)))
EXPOSURE = Exposure(0.05, 1 / 20)


@dataclass(frozen=True)
class Case:
    """A sharp crop, its blurred picture in linear light, and the PSF that is believed to have made it."""

    sharp: Image
    blurred: Image
    kernel: Image
    noise: float | None
    encoded: bool


@cache
def pictures() -> list[Image]:
    """Return the sharp pictures, values in [0, 1], reduced by whole factors until they are sharp at each pixel."""
    bundled = Path(skimage.data.__file__).parent
    sources = {
        DATA / "sharp" / "imagecompression_flower_foveon_rgb8.png": (1, 2, 3),
        DATA / "sharp" / "opensfm_berlin_01.jpg": (2, 3, 4),
        **{bundled / name: (1,) for name in ("astronaut.png", "chelsea.png", "coffee.png", "rocket.jpg")},
        bundled / "motorcycle_left.png": (1, 2),
    }
    return reduced(sources)


def reduced(sources: Mapping[Path, tuple[int, ...]]) -> list[Image]:
    """Return pictures reduced by each of their factors, values in [0, 1]."""
    found = []
    for path, factors in sources.items():
        with Pillow.open(path) as stored:
            for factor in factors:
                size = stored.width // factor, stored.height // factor
                smaller = stored.convert("RGB").resize(size, Pillow.Resampling.LANCZOS)
                found.append(np.asarray(smaller, dtype=np.float32) / np.float32(255))
    return found


def drawn(rng: np.random.Generator) -> Case:
    """Draw a case."""
    sources = pictures()
    areas = np.sqrt([picture.shape[0] * picture.shape[1] for picture in sources])
    believed, true = kernels(rng)
    tall, wide = SIDE + true.shape[0] - 1, SIDE + true.shape[1] - 1
    source = sources[rng.choice(len(sources), p=areas / areas.sum())]
    top, left = (int(rng.integers(0, n - side + 1)) for n, side in zip(source.shape, (tall, wide), strict=False))
    crop = source[top : top + tall, left : left + wide]
    crop = crop if rng.random() < 0.5 else crop.mean(axis=2, keepdims=True)
    encoded = rng.random() < 0.5
    light = to_linear(crop, "srgb") if encoded else crop
    noise = float(np.exp(rng.uniform(*np.log(NOISES)))) / 255
    blurred = fftconvolve(light, true[:, :, None], "valid", axes=(0, 1))
    blurred = (blurred + rng.normal(0.0, noise, blurred.shape)).astype(np.float32)
    known = rng.random() < 0.3
    if encoded and rng.random() < JPEG_SHARE and blurred.shape[2] == 3:
        blurred, known = jpeg(blurred), False
    inside = tuple(slice(n // 2, n // 2 + SIDE) for n in true.shape)
    return Case(light[inside], blurred, believed, noise if known else None, encoded)


def kernels(rng: np.random.Generator) -> tuple[Image, Image]:
    """Return the PSF that is believed, and the true one."""
    camera = Camera(SIDE, SIDE, 1000.0)
    shake = hand_shake(0.2, seed=int(rng.integers(2**31)))
    aim = float(np.exp(rng.uniform(*np.log(SIZES))))
    reach = max(psfs(shake, camera, EXPOSURE, mode="global").size)
    error, delay = rng.uniform(-1, 1, 2) * (SIZE_ERROR, DELAY) * (rng.random() < 0.5)
    size = aim / reach
    return kernel(shake, camera, size), kernel(shake, camera, size * (1.0 + error), delay)


def kernel(
    shake: GyroLog, camera: Camera, size: float, delay: float = 0.0, drift: tuple[float, float] = (0.0, 0.0)
) -> Image:
    """Return the PSF of a shake: so many times larger, later by `delay` s, and with a drift (px per exposure)."""
    across, down = drift
    # A turn about y moves the picture along x.
    rate = np.array([down, across, 0.0]) / (camera.focal_length[0] * EXPOSURE.duration)
    log = GyroLog(shake.t, shake.omega * (size, size, 0.0) + rate)
    drawn: Image = psfs(log, camera, EXPOSURE.shifted(delay), mode="global").kernels[0, 0]
    return drawn


def equations(seed: tuple[int, int]) -> list[tuple[int, float, FloatArray, FloatArray]]:
    """Return the class, the weight, and the normal matrix and right-hand side of each channel of a case."""
    case, found = drawn(np.random.default_rng(seed)), []
    bank = PsfBank.for_picture(case.kernel, case.blurred.shape)
    tuning = Tuning.of(case.blurred, bank, noise=case.noise, one_filter=True)
    prior = tuning.wavelet()
    solver = TileQuadratic(bank, case.blurred.shape, nsr=max(tuning.border_error, LEAST_WAVELET_NSR), threads=1)
    solver.prepare(case.blurred)
    latents = np.stack([solver.solve(prior.weight * ratio) for ratio in RATIOS])
    channels = latents.shape[3]
    mix = (OPPONENT if channels == 3 else np.eye(1)).astype(np.float32)
    slope = np.ones(case.sharp.shape[:2])
    if case.encoded:
        light = case.sharp.mean(axis=2).clip(1e-3, 1)
        slope = (from_linear(light * 1.01, "srgb") - from_linear(light, "srgb")) / (0.01 * light)
    # The border is left out: what happens there depends on how the picture is continued.
    border = max(case.kernel.shape)
    inside = np.s_[border:-border, border:-border]
    error = np.square((latents[1] - case.sharp)[inside] * slope[inside][..., None]).mean()
    variances = 9 * np.reshape(prior.variances, (len(RATIOS), LEVELS, 3)).astype(np.float32)
    padded = np.pad(latents, [(0, 0), (HALO, HALO), (HALO, HALO), (0, 0)], mode="symmetric")
    for c in range(channels):
        terms = np.zeros((TERMS, *slope[inside].shape), dtype=np.float32)
        for index, term in frame_terms(padded @ mix[c], variances):
            terms[position(index)] += term[HALO:-HALO, HALO:-HALO][inside]
        design = (terms * slope[inside].astype(np.float32)).reshape(TERMS, -1)
        truth = ((case.sharp @ mix[c])[inside] * slope[inside]).ravel().astype(np.float32)
        scale = 1.0 / (np.sqrt(error) * truth.size)
        found.append((int(c > 0), prior.weight, scale * (design @ design.T), scale * (design @ truth)))
    return found


def position(index: tuple[int, ...]) -> int:
    """Return the place of a factor among all: means first, then differences; those across and down share theirs."""
    if len(index) == 1:
        return index[0]
    k, level, orientation, gate = index
    places = (len(RATIOS), LEVELS, 2, 1 + len(GATES))
    return len(RATIOS) + int(np.ravel_multi_index((k, level, orientation // 2, gate), places))


def solved(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the factors (Q, TERMS) that solve the normal equations (Q TERMS); the factors of means sum to 1."""
    knots, size = len(KNOTS), len(KNOTS) * TERMS
    scale = np.trace(normal) / size
    change = np.kron(np.diff(np.eye(knots), axis=0), np.eye(TERMS))
    full = normal + scale * (RIDGE * np.eye(size) + SMOOTH * change.T @ change)
    sums = np.kron(np.eye(knots), np.arange(TERMS) < len(RATIOS))
    system = np.block([[full, sums.T], [sums, np.zeros((knots, knots))]])
    solution = np.linalg.solve(system, np.concatenate([right, np.ones(knots)]))
    return solution[:size].reshape(knots, TERMS)


def main() -> None:
    """Learn the factors and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=FACTORS)
    options = parser.parse_args()
    require_data()
    size = len(KNOTS) * TERMS
    normal, right, weights = np.zeros((2, size, size)), np.zeros((2, size)), []
    seeds = [(options.seed, n) for n in range(options.cases)]
    with ProcessPoolExecutor(thread_count(None), multiprocessing.get_context("spawn")) as pool:
        for found in track(pool.map(equations, seeds), "cases", total=len(seeds)):
            for kind, weight, matrix, vector in found:
                shares = hats(weight, KNOTS)
                normal[kind] += np.kron(np.outer(shares, shares), matrix)
                right[kind] += np.kron(shares, vector)
                weights.append(np.log10(weight))
    factors = np.stack([solved(*each) for each in zip(normal, right, strict=True)])
    shape = (2, len(KNOTS), len(RATIOS), LEVELS, 2, 1 + len(GATES))
    content = {
        "ratios": RATIOS,
        "knots": KNOTS,
        "means": factors[..., : len(RATIOS)],
        "differences": factors[..., len(RATIOS) :].reshape(shape),
    }
    lines = ",\n".join(f' "{name}": {json.dumps(values.round(5).tolist())}' for name, values in content.items())
    options.output.write_text("{\n" + lines + "\n}\n")
    print(f"log10 of the weights: {np.percentile(weights, [0, 5, 50, 95, 100]).round(2)}; wrote {options.output}")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
