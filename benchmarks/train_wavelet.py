"""Learn the factors of the wavelet prior: ``python -m benchmarks.train_wavelet``; writes rsdeblur/deconv/wavelet.json.

Crops of sharp pictures are blurred with PSFs of a simulated hand and restored with the solver and the strengths of the
package; the factors minimise the squared error of the sum of the shrunk restorations. Those of the first sum are
learned first, those of the second one with them. They are learned on other pictures and PSFs than the benchmarks use:
`flower_foveon` and `berlin_01` of the folder `sharp` beside the recordings, and pictures that scikit-image contains.

A case draws the size of the blur, the noise, whether values are light or sRGB (then errors count in sRGB), whether a
colour picture is stored as JPEG or processed as by a phone, and whether the noise is given or estimated. In half of the
cases the motion is wrong: up to 3 % too large or too small, and up to 2 ms early or late. A case has the weight one
over the root mean square error of its middle restoration: without it hard cases would dominate; its square would count
gains in dB, and flat pictures would dominate. Everything is seeded.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import skimage.data
from PIL import Image as Pillow
from rich.progress import track
from scipy.signal import fftconvolve

from benchmarks.data import DATA, Image, require_data
from benchmarks.phone import TRUTH_NOISE, TRUTH_QUALITY, processed
from benchmarks.priors import jpeg
from rsdeblur import Camera, Exposure, GyroLog, PsfBank, from_linear, hand_shake, to_linear
from rsdeblur._util.threads import thread_count
from rsdeblur.deconv import TileQuadratic
from rsdeblur.deconv.wavelet import FACTORS, MIDDLE, OPPONENT, PENALTIES, FrameSum, add_up, features
from rsdeblur.kernels.frame import GATES, HALO, LEVELS
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.pipeline.steps import LEAST_WAVELET_NSR
from rsdeblur.tuning import Tuning
from rsdeblur.types import FloatArray
from tests.oracles.frame import terms as frame_terms

RATIOS = np.array([0.05, 0.4, 3.0])
KNOTS = np.array([-2.25, -1.5, -0.75, 0.0])
SIDE = 224
# Bounds of the draws: noise in units of 255, longest side of the PSF in px, relative error and delay (s) of the motion.
NOISES, SIZES, SIZE_ERROR, DELAY = (0.5, 14.0), (1.0, 45.0), 0.03, 0.002
# Shares of the colour pictures in sRGB that are stored as JPEG, and processed as by a phone.
JPEG_SHARE, PHONE_SHARE = 0.3, 0.3
# Noise in a phone's picture as a share of that drawn, which is the same in shadows; a phone's falls with the light.
PHONE_NOISE = 0.4
# Weight of the squared change of a factor from knot to knot, and of its squared difference from that with which the
# last picture comes back, relative to the mean diagonal.
SMOOTH, RIDGE = 1e-4, 1e-5
# Factors of one picture, for one class at one knot: means, and differences of two kinds with each gate.
TERMS = 1 + LEVELS * 2 * (1 + len(GATES))
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
    believed, true = kernels(rng)
    tall, wide = SIDE + true.shape[0] - 1, SIDE + true.shape[1] - 1
    sources = [picture for picture in sources if picture.shape[0] >= tall and picture.shape[1] >= wide]
    areas = np.sqrt([picture.shape[0] * picture.shape[1] for picture in sources])
    source = sources[rng.choice(len(sources), p=areas / areas.sum())]
    top, left = (int(rng.integers(0, n - side + 1)) for n, side in zip(source.shape, (tall, wide), strict=False))
    crop = source[top : top + tall, left : left + wide]
    colour, encoded = rng.random() < 0.5, rng.random() < 0.5
    crop = crop if colour else crop.mean(axis=2, keepdims=True)
    light = to_linear(crop, "srgb") if encoded else crop
    noise = float(np.exp(rng.uniform(*np.log(NOISES)))) / 255
    sharp = light[tuple(slice(n // 2, n // 2 + SIDE) for n in true.shape)]
    blurred = fftconvolve(light, true[:, :, None], "valid", axes=(0, 1)).astype(np.float32)
    known, way = rng.random() < 0.3, rng.random()
    if encoded and colour and way < PHONE_SHARE:
        sharp = phone_light(sharp, rng, noise=TRUTH_NOISE, quality=TRUTH_QUALITY)
        return Case(sharp, phone_light(blurred, rng, noise=PHONE_NOISE * noise), believed, None, encoded)
    blurred += rng.normal(0.0, noise, blurred.shape).astype(np.float32)
    if encoded and colour and way < PHONE_SHARE + JPEG_SHARE:
        blurred, known = jpeg(blurred), False
    return Case(sharp, blurred, believed, noise if known else None, encoded)


def phone_light(light: Image, rng: np.random.Generator, **settings: Any) -> Image:
    """Return the light of what a phone would store."""
    stored = processed(light, rng, **settings)
    return to_linear(stored.astype(np.float32) / np.float32(255), "srgb")


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
    drawn: Image = psfs(log, camera, replace(EXPOSURE, start=EXPOSURE.start + delay), mode="global").kernels[0, 0]
    return drawn


def equations(seed: tuple[int, int], linear: FrameSum | None) -> list[tuple[int, FloatArray, FloatArray, FloatArray]]:
    """Return the class, the features, and the normal matrix and right-hand side of each channel of a case.

    They are those of the first sum, or, if its factors are given as `linear`, of the second one.
    """
    case, found = drawn(np.random.default_rng(seed)), []
    bank = PsfBank.for_picture(case.kernel, case.blurred.shape)
    tuning = Tuning.of(case.blurred, bank, noise=case.noise, one_filter=True)
    prior = tuning.wavelet().with_peak_of(case.blurred)
    solver = TileQuadratic(bank, case.blurred.shape, nsr=max(tuning.border_error, LEAST_WAVELET_NSR), threads=1)
    solver.prepare(case.blurred)
    latents = [solver.solve(prior.weight * ratio) for ratio in RATIOS]
    slope = np.ones(case.sharp.shape[:2])
    if case.encoded:
        light = case.sharp.mean(axis=2).clip(1e-3, 1)
        slope = (from_linear(light * 1.01, "srgb") - from_linear(light, "srgb")) / (0.01 * light)
    # The border is left out: what happens there depends on how the picture is continued.
    border = max(*case.kernel.shape, HALO)
    inside = np.s_[border:-border, border:-border]
    error = np.square((latents[MIDDLE] - case.sharp)[inside] * slope[inside][..., None]).mean()
    place, variances = features(prior.weight, prior.noise_share, KNOTS), prior.variances
    if linear is not None:
        start = add_up(latents, variances, linear.at(place), periodic=False, threads=1)
        *_, (pilot, _) = prior.sparse.steps(solver, start=start, penalties=PENALTIES, ahead=0.0, threads=1)
        latents, variances = [latents[MIDDLE], pilot], variances[[MIDDLE, MIDDLE]]
    channels = latents[0].shape[2]
    mix = (OPPONENT if channels == 3 else np.eye(1)).astype(np.float32)
    padded = np.pad(latents, [(0, 0), (HALO, HALO), (HALO, HALO), (0, 0)], mode="symmetric")
    for c in range(channels):
        design = designed(padded @ mix[c], 9 * variances)[:, HALO:-HALO, HALO:-HALO][:, *inside] * slope[inside]
        design = design.reshape(len(design), -1).astype(np.float64)
        truth = ((case.sharp @ mix[c])[inside] * slope[inside]).ravel()
        scale = 1.0 / (np.sqrt(error) * truth.size)
        found.append((int(c > 0), place, scale * (design @ design.T), scale * (design @ truth)))
    return found


def designed(planes: Image, variances: Image) -> Image:
    """Return the pictures that the factors multiply: the means of all `planes` first, then the differences.

    Differences across and down have the same factor.
    """
    count = len(planes)
    terms = np.zeros((count * TERMS, *planes.shape[1:]), dtype=np.float32)
    places = (count, LEVELS, 2, 1 + len(GATES))
    for (k, *rest), term in frame_terms(planes, variances):
        if rest:
            level, orientation, gate = rest
            terms[count + int(np.ravel_multi_index((k, level, orientation // 2, gate), places))] += term
        else:
            terms[k] += term
    return terms


def solved(normal: FloatArray, right: FloatArray, count: int) -> FloatArray:
    """Return the factors (Q, terms) of `count` pictures that solve normal equations; those of means sum to 1."""
    knots, terms = len(KNOTS), count * TERMS
    scale = np.trace(normal) / len(right)
    # The factors with which the last picture comes back: 1 for its means and for its differences without a gate.
    last = np.zeros(terms)
    last[count - 1] = 1.0
    last[count:].reshape(count, -1, 1 + len(GATES))[-1, :, 0] = 1.0
    last = np.concatenate([np.tile(last, knots), np.zeros(terms)])
    change = np.kron(np.diff(np.eye(knots, knots + 1), axis=0), np.eye(terms))
    full = normal + scale * (RIDGE * np.eye(len(right)) + SMOOTH * change.T @ change)
    sums = np.kron(np.eye(knots + 1), np.arange(terms) < count)
    system = np.block([[full, sums.T], [sums, np.zeros((knots + 1, knots + 1))]])
    solution = np.linalg.solve(system, np.concatenate([right + scale * RIDGE * last, np.ones(knots), [0.0]]))
    return solution[: len(right)].reshape(knots + 1, terms)


def learned(pool: ProcessPoolExecutor, seeds: list[tuple[int, int]], linear: FrameSum | None) -> FrameSum:
    """Return the factors of the first sum, or of the second one after the first sum `linear`."""
    count, rows = len(RATIOS) if linear is None else 2, len(KNOTS) + 1
    size = rows * count * TERMS
    normal, right = np.zeros((2, size, size)), np.zeros((2, size))
    for found in track(pool.map(partial(equations, linear=linear), seeds), "cases", total=len(seeds)):
        for kind, place, matrix, vector in found:
            normal[kind] += np.kron(np.outer(place, place), matrix)
            right[kind] += np.kron(place, vector)
    factors = np.stack([solved(*each, count) for each in zip(normal, right, strict=True)]).round(5)
    return FrameSum(factors[..., :count], factors[..., count:].reshape(2, rows, count, LEVELS, 2, 1 + len(GATES)))


def main() -> None:
    """Learn the factors and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=FACTORS)
    options = parser.parse_args()
    require_data()
    seeds = [(options.seed, n) for n in range(options.cases)]
    with ProcessPoolExecutor(thread_count(None), multiprocessing.get_context("spawn")) as pool:
        linear = learned(pool, seeds, None)
        piloted = learned(pool, seeds, linear)
    lines = [f' "{name}": {json.dumps(values.tolist())}' for name, values in (("ratios", RATIOS), ("knots", KNOTS))]
    for name, each in (("linear", linear), ("piloted", piloted)):
        means, differences = (json.dumps(values.tolist()) for values in (each.means, each.differences))
        lines.append(f' "{name}": {{"means": {means},\n  "differences": {differences}}}')
    options.output.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    print(f"wrote {options.output}")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
