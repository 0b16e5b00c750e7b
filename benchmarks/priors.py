"""All modes with all priors, and the quality of automatic strengths: ``python -m benchmarks.priors [--markdown FILE]``.

The first table deblurs the whole captures with automatic strengths. The second deblurs the middle of every second
capture, at noise of 30, 40 and 50 dB with the right model, and at 40 and 50 dB with a wrong one: a focal length 1 % too
long, gyro timestamps 2 ms late, rates with white noise of 0.01 rad/s, the picture stored as JPEG of quality 90. It
compares the automatic strength with the fixed strength that is best on average over the captures.

Pictures are enlarged twice, as soft as a lens leaves them; with --own-size they are as sharp as their pixels. Processes
share the captures.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Pillow
from rich.progress import track

from benchmarks.captures import QUICK, SimulatedCapture, quality, simulated
from benchmarks.data import Image, noted
from benchmarks.tables import markdown, report, write
from rsdeblur import Camera, GyroLog, deblur
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import PRIORS, Prior
from rsdeblur.image.transfer import from_linear, to_linear
from rsdeblur.simulation import Simulation

# Another mode is one more entry.
MODES: dict[str, dict[str, Any]] = {
    "global": {"mode": "global"},
    "banded 16": {"mode": "banded", "bands": 16},
    "rowwise": {"mode": "rowwise"},
}
# The fixed strengths: values of the NSR for the Wiener filter, of the weight for the others.
Ladders = dict[Prior, tuple[float, ...]]
LADDERS: Ladders = {
    "wiener": (0.01, 0.03, 0.1, 0.3, 1.0),
    "gradient": (0.01, 0.03, 0.1, 0.3, 1.0),
    "tv": (0.001, 0.003, 0.01, 0.03, 0.1),
    "hyper-laplacian": (0.0003, 0.001, 0.003, 0.01, 0.03),
    "cnn": (1e-6, 3e-6, 1e-5, 3e-5, 1e-4),
}
# (noise in dB, whether the model is wrong)
SITUATIONS = ((30, False), (40, False), (50, False), (40, True), (50, True))
FOCAL_ERROR, OFFSET_ERROR, RATE_NOISE, JPEG_QUALITY = 0.01, 0.002, 0.01, 90
# Width and height of the part that the second table deblurs, px.
MIDDLE = 512, 384


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=int, help="only the first N of the 14 captures")
    parser.add_argument("--own-size", action="store_true", help="512x384 from pictures that are not enlarged")
    parser.add_argument("--quick", action="store_true", help="one small capture, to see that it runs")
    parser.add_argument("--strengths-only", action="store_true", help="without the first table")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    parser.add_argument("--json", type=Path, help="write all scores")
    options = parser.parse_args()
    enlarged, count = (QUICK, 1) if options.quick else (1 if options.own_size else 2, options.captures)
    drawn = simulated(count, noise=0.0, enlarged=enlarged)
    captures = list(track(drawn, "simulating", total=count or 14))
    situations = SITUATIONS[-1:] if options.quick else SITUATIONS
    ladders = {prior: ladder[:1] for prior, ladder in LADDERS.items()} if options.quick else LADDERS
    scores = run(captures, modes=not options.strengths_only, situations=situations, ladders=ladders)
    report(noted(scores["markdown"]), options.markdown)
    if options.json:
        write(options.json, json.dumps({k: v for k, v in scores.items() if k != "markdown"}, indent=1))


def run(
    captures: Sequence[SimulatedCapture],
    *,
    modes: bool = True,
    situations: Sequence[tuple[int, bool]] = SITUATIONS,
    ladders: Ladders = LADDERS,
) -> dict[str, Any]:
    """Score everything on captures without noise and return scores and tables."""
    # Every solve uses one thread.
    with ProcessPoolExecutor(thread_count(None), multiprocessing.get_context("spawn")) as pool:
        results = _scored(pool, modes_scores, captures, "modes and priors") if modes else {}
        score = partial(strengths_scores, situations=situations, ladders=ladders)
        strengths = _scored(pool, score, captures[::2], "strengths")
    tables = [strengths_table(strengths, ladders), harm_table(strengths)]
    if modes:
        tables.insert(0, modes_table(results))
    return {"modes": results, "strengths": strengths, "markdown": "\n\n".join(tables)}


def _scored(
    pool: Executor, score: Callable[[SimulatedCapture], Any], captures: Sequence[SimulatedCapture], title: str
) -> dict[str, Any]:
    results = track(pool.map(score, captures), title, total=len(captures))
    return {capture.name: scores for capture, scores in zip(captures, results, strict=True)}


def modes_scores(capture: SimulatedCapture) -> dict[str, tuple[float, float]]:
    """Return PSNR and SSIM of every mode with every prior, at 40 dB of noise."""
    capture = noisy(capture, 40)
    scores = {"blurred": quality(capture.pictures.rolling, capture.pictures.blurred)}
    for name, mode in MODES.items():
        for prior in PRIORS:
            image = deblur(
                capture.pictures.blurred, *capture.recording, prior=prior, saturation="ignore", threads=1, **mode
            ).image
            scores[f"{name}, {prior}"] = quality(capture.pictures.rolling, image)
    return scores


def strengths_scores(
    capture: SimulatedCapture, situations: Sequence[tuple[int, bool]], ladders: Ladders
) -> dict[str, dict[str, float]]:
    """Return the PSNR of every prior at every strength in some situations."""
    rows = {}
    for decibels, wrong in situations:
        part = noisy(middle(capture), decibels)
        part = with_errors(part) if wrong else part
        row = {"blurred": quality(part.pictures.rolling, part.pictures.blurred)[0]}
        for prior, strength in ((prior, each) for prior, ladder in ladders.items() for each in ("auto", *ladder)):
            kwargs: dict[str, Any] = {"prior": prior, "nsr" if prior == "wiener" else "weight": strength}
            image = deblur(part.pictures.blurred, *part.recording, saturation="ignore", threads=1, **kwargs).image
            row[f"{prior} {strength}"] = quality(part.pictures.rolling, image)[0]
        rows[f"{decibels} dB, {'wrong' if wrong else 'right'} model"] = row
    return rows


def middle(capture: SimulatedCapture, size: tuple[int, int] = MIDDLE) -> SimulatedCapture:
    """Return the middle of a capture, or all of a smaller one."""
    camera = capture.camera
    width, height = (min(n, most) for n, most in zip((camera.width, camera.height), size, strict=True))
    left, top = (camera.width - width) // 2, (camera.height - height) // 2
    pictures = Simulation(*(p[top : top + height, left : left + width] for p in capture.pictures))
    return replace(capture, camera=camera.cropped(left, top, width, height), pictures=pictures)


def noisy(capture: SimulatedCapture, decibels: float) -> SimulatedCapture:
    """Return the capture with white noise added."""
    clean = capture.pictures.blurred
    noise = np.random.default_rng(0).normal(0.0, 10 ** (-decibels / 20), clean.shape).astype(np.float32)
    return replace(capture, pictures=capture.pictures._replace(blurred=clean + noise))


def with_errors(capture: SimulatedCapture) -> SimulatedCapture:
    """Return the capture with the typical errors of real recordings."""
    log, camera = with_recording_errors(capture.log, capture.camera)
    pictures = capture.pictures._replace(blurred=jpeg(capture.pictures.blurred))
    return replace(capture, log=log, camera=camera, pictures=pictures)


def with_recording_errors(log: GyroLog, camera: Camera) -> tuple[GyroLog, Camera]:
    """Return a log and a camera with the typical errors of real ones."""
    noise = np.random.default_rng(0).normal(0.0, RATE_NOISE, log.omega.shape)
    fx, fy = camera.focal_length
    wrong = GyroLog(log.t + OFFSET_ERROR, log.omega + noise, log.epoch_ns)
    return wrong, replace(camera, focal_length=(fx * (1 + FOCAL_ERROR), fy * (1 + FOCAL_ERROR)))


def jpeg(light: Image) -> Image:
    """Return a picture after a round trip through JPEG."""
    stored = BytesIO()
    pixels = (from_linear(light.clip(0, 1), "srgb") * 255).round().astype(np.uint8)
    Pillow.fromarray(pixels).save(stored, "JPEG", quality=JPEG_QUALITY)
    with Pillow.open(stored) as picture:
        return to_linear(np.asarray(picture, dtype=np.float32) / np.float32(255), "srgb")


def modes_table(scores: dict[str, dict[str, tuple[float, float]]]) -> str:
    """Return the table of PSNR, a row per capture, with the means."""
    names = list(next(iter(scores.values())))
    rows = [[capture, *(f"{row[name][0]:.2f}" for name in names)] for capture, row in scores.items()]
    for label, which, form in (("**mean PSNR**", 0, ".2f"), ("**mean SSIM**", 1, ".3f")):
        means = [np.mean([row[name][which] for row in scores.values()]) for name in names]
        rows.append([label, *(f"{mean:{form}}" for mean in means)])
    return "PSNR in dB, strengths automatic, noise 40 dB:\n\n" + markdown(["capture", *names], rows)


def strengths_table(scores: dict[str, dict[str, dict[str, float]]], ladders: Ladders) -> str:
    """Compare the automatic strength, and the best one for each capture, with the best fixed strength."""
    rows = []
    for situation in next(iter(scores.values())):
        results = [row[situation] for row in scores.values()]
        for prior, ladder in ladders.items():
            table = np.array([[row[f"{prior} {strength}"] for strength in ladder] for row in results])
            best = table.mean(axis=0)
            auto = np.mean([row[f"{prior} auto"] for row in results])
            gains = (auto - best.max(), table.max(axis=1).mean() - best.max())
            cells = [f"{best.max():.2f}", f"{ladder[best.argmax()]:g}", *(f"{gain:+.2f}" for gain in gains)]
            rows.append([situation, prior, *cells])
    columns = ["situation", "prior", "best fixed, dB", "at", "auto gains, dB", "best of each capture gains, dB"]
    return "Automatic against fixed strengths, mean PSNR:\n\n" + markdown(columns, rows)


def harm_table(scores: dict[str, dict[str, dict[str, float]]]) -> str:
    """Return the table of the least gain of the automatic strength over the input, among all captures."""
    rows = []
    for situation in next(iter(scores.values())):
        results = [row[situation] for row in scores.values()]
        least = [min(row[f"{prior} auto"] - row["blurred"] for row in results) for prior in PRIORS]
        rows.append([situation, *(f"{gain:+.2f}" for gain in least)])
    return "Least gain over the input among the captures, dB:\n\n" + markdown(["situation", *PRIORS], rows)


if __name__ == "__main__":
    main()
