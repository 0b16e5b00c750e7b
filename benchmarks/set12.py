"""Known kernels on Set12, beside published figures: ``python -m benchmarks.set12 [--quick] [--markdown FILE]``.

The 12 grey pictures of Set12 are blurred with the 8 kernels of Levin et al. (2009) [1]_, with white noise of 2.55, 7.65
and 12.75 of 255. *Valid*: the blurred picture is the part that the kernel saw in full, so nothing wraps around, and the
solver has to continue it. *Circular*: the picture repeats and the solver knows it, so only the prior counts. Values are
light (`transfer="linear"`). PSNR is over the points all of whose light was recorded, which leaves out half a kernel
along each border, and of the valid blur over the whole frame, too. Results are clipped to [0, 1], and means are over
all pictures and kernels.

Every prior runs with automatic strength, with the noise given, and with each strength of a ladder; "best fixed" is the
one with the best mean. --quick takes four small pictures and three kernels; published means are over all. Every solve
uses one thread, and processes share the pictures.

The data are in the folder `set12` beside the recordings (RSDEBLUR_DATA): `01.png` to `12.png`, and the kernels as
arrays in `levin09.npz`. Without them there are other pictures and kernels, and no published figures.

.. [1] A. Levin, Y. Weiss, F. Durand and W. T. Freeman, "Understanding and evaluating blind deconvolution algorithms",
   CVPR 2009.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from scipy import fft
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import data
from benchmarks.data import Image, noted
from benchmarks.tables import markdown, report, write
from rsdeblur import deconvolve
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import PRIORS, Prior

Blur = Literal["valid", "circular"]
Region = Literal["seen", "frame"]
NOISES = (2.55, 7.65, 12.75)
QUICK = (1, 3, 5, 7), (0, 3, 5)
# Factors on the variance of the noise (on its standard deviation for the sparse priors) that make the ladder of fixed
# strengths: values of the NSR for the Wiener filter, of the weight for the others.
LADDERS: dict[Prior, tuple[float, ...]] = {
    "wiener": (30.0, 100.0, 300.0, 1000.0),
    "gradient": (15.0, 30.0, 60.0, 120.0),
    "tv": (0.04, 0.08, 0.15, 0.3),
    "hyper-laplacian": (0.04, 0.08, 0.15, 0.3),
}
# Mean PSNR at the noises above, of A. Nan, Y. Quan and H. Ji, "Variational-EM-based deep learning for noise-blind image
# deblurring", CVPR 2020, Tables 3 and 4 (github.com/ysnan/VEM-NBD). All but EPLL and IDD-BM3D are trained.
PUBLISHED: dict[str, tuple[float | None, ...]] = {
    "EPLL (2011)": (27.61, 25.24, 23.87),
    "CSF (2014)": (29.37, 26.41, 25.10),
    "IRCNN (2017)": (30.53, 27.09, None),
    "IDD-BM3D (2012)": (31.43, 27.56, 25.95),
    "FDN (2017)": (31.43, 27.89, 26.28),
    "VEM (2020)": (31.93, 28.47, 26.77),
}


class Score(NamedTuple):
    """PSNR in dB over the points that were seen in full and over the whole frame, and the time of the solve in s."""

    seen: float
    frame: float
    seconds: float


@dataclass(frozen=True)
class Case:
    """A picture, numbered from 1, and a kernel, numbered from 0, at one noise (of 255); with a `side`, its middle."""

    picture: int
    kernel: int
    noise: float
    blur: Blur
    side: int | None = None

    def blurred(self) -> tuple[Image, Image, NDArray[np.float64]]:
        """Return the sharp picture, the blurred one of the same shape, and the kernel."""
        sharp = data.set12(self.picture)
        if self.side:
            sharp = sharp[tuple(slice((n - self.side) // 2, (n + self.side) // 2) for n in sharp.shape)]
        kernel = data.kernels()[self.kernel]
        tall, wide = kernel.shape
        wrapped = np.zeros(sharp.shape)
        wrapped[:tall, :wide] = kernel
        wrapped = np.roll(wrapped, (-(tall // 2), -(wide // 2)), (0, 1))
        blurred = fft.irfft2(fft.rfft2(sharp) * fft.rfft2(wrapped), sharp.shape)
        if self.blur == "valid":
            inside = np.s_[tall // 2 : -(tall // 2), wide // 2 : -(wide // 2)]
            sharp, blurred = sharp[inside], blurred[inside]
        seed = [self.picture, self.kernel, round(100 * self.noise)]
        noise = np.random.default_rng(seed).normal(0.0, self.noise / 255, blurred.shape)
        return sharp.astype(np.float32), (blurred + noise).astype(np.float32), kernel


def solve(case: Case) -> dict[str, Score]:
    """Return the scores of every prior at every strength."""
    sharp, blurred, kernel = case.blurred()
    scores = {"blurred": _score(sharp, blurred, kernel.shape, 0.0)}
    sigma = case.noise / 255
    for prior in PRIORS:
        border: Literal["periodic", "auto"] = "periodic" if case.blur == "circular" else "auto"
        strengths: dict[str, dict[str, Any]] = {"automatic": {}, "noise given": {"noise": sigma}}
        for factor in LADDERS.get(prior, ()):
            name, power = ("nsr", 2) if prior == "wiener" else ("weight", 2 if prior == "gradient" else 1)
            strengths[f"{factor:g}"] = {name: factor * sigma**power}
        for label, strength in strengths.items():
            begin = time.perf_counter()
            result = deconvolve(
                blurred,
                kernel,
                prior=prior,
                border=border,
                transfer="linear",
                saturation="ignore",
                threads=1,
                **strength,
            )
            seconds = time.perf_counter() - begin
            scores[f"{prior}, {label}"] = _score(sharp, result.image, kernel.shape, seconds)
    return scores


def _score(sharp: Image, image: Image, size: tuple[int, ...], seconds: float) -> Score:
    seen = tuple(slice(n // 2, -(n // 2)) for n in size)
    within, frame = (
        float(peak_signal_noise_ratio(sharp[part], image[part].clip(0, 1), data_range=1.0)) for part in (seen, ...)
    )
    return Score(within, frame, seconds)


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="four pictures of 256x256 px and three kernels")
    parser.add_argument("--side", type=int, help="only the middle of each picture, px, to see that it runs")
    parser.add_argument("--blur", choices=("valid", "circular"), help="only this blur")
    parser.add_argument("--noise", type=float, choices=NOISES, help="only this noise")
    parser.add_argument("--jobs", type=int, default=thread_count(None), help="number of processes")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    parser.add_argument("--json", type=Path, help="write all scores")
    options = parser.parse_args()
    pictures, chosen = QUICK if options.quick else (range(1, 13), range(len(data.kernels())))
    blurs: tuple[Blur, ...] = (options.blur,) if options.blur else ("valid", "circular")
    noises = (options.noise,) if options.noise else NOISES
    cases = [Case(*each, options.side) for each in _product(pictures, chosen, noises, blurs)]
    with ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn")) as pool:
        scores = list(track(pool.map(solve, cases), "solving", total=len(cases)))
    shown: list[tuple[Blur, Region]] = [("valid", "seen"), ("valid", "frame"), ("circular", "seen")]
    text = "\n\n".join(table(*each, noises, cases, scores) for each in shown if each[0] in blurs)
    report(noted(text), options.markdown)
    if options.json:
        records = [vars(case) | {"scores": score} for case, score in zip(cases, scores, strict=True)]
        write(options.json, json.dumps(records, indent=1))


def _product(
    pictures: Iterable[int], chosen: Iterable[int], noises: Iterable[float], blurs: Iterable[Blur]
) -> Iterable[tuple[int, int, float, Blur]]:
    # Small pictures last, so that no process waits long for another one at the end.
    for picture in sorted(pictures, reverse=True):
        for kernel in chosen:
            for noise in noises:
                for blur in blurs:
                    yield picture, kernel, noise, blur


def table(
    blur: Blur, region: Region, noises: tuple[float, ...], cases: list[Case], scores: list[dict[str, Score]]
) -> str:
    """Return the table of one blur and region: our priors, then the published methods."""
    columns = ["prior"]
    for noise in noises:
        columns += [f"{noise:g}: automatic", "noise given", "best fixed", "at"]
    means: dict[float, dict[str, Score]] = {}
    for noise in noises:
        own = [s for case, s in zip(cases, scores, strict=True) if (case.blur, case.noise) == (blur, noise)]
        means[noise] = {name: Score(*np.mean([each[name] for each in own], axis=0)) for name in own[0]}
    psnr = {noise: {name: getattr(mean, region) for name, mean in each.items()} for noise, each in means.items()}
    rows = [["blurred", *(cell for n in noises for cell in (f"{psnr[n]['blurred']:.2f}", "", "", ""))]]
    for prior in PRIORS:
        row: list[str] = [prior]
        for noise in noises:
            row += [f"{psnr[noise][f'{prior}, {label}']:.2f}" for label in ("automatic", "noise given")]
            ladder = {f"{factor:g}": psnr[noise][f"{prior}, {factor:g}"] for factor in LADDERS.get(prior, ())}
            best = max(ladder, key=ladder.__getitem__, default=None)
            row += ["", ""] if best is None else [f"{ladder[best]:.2f}", best]
        rows.append(row)
    for method, figures in PUBLISHED.items() if data.RECORDED else ():
        known = dict(zip(NOISES, figures, strict=True))
        rows.append([method, *(cell for n in noises for cell in (f"{known[n]:.2f}" if known[n] else "", "", "", ""))])
    columns.append("ms per solve")
    for row in rows:
        times = [
            1e3 * mean[f"{row[0]}, automatic"].seconds for mean in means.values() if f"{row[0]}, automatic" in mean
        ]
        row.append(f"{np.mean(times):.0f}" if times else "")
    count = len({case.picture for case in cases}), len({case.kernel for case in cases})
    where = "points seen in full" if region == "seen" else "the whole frame"
    title = f"PSNR in dB over {where}, {blur} blur, {count[0]} pictures x {count[1]} kernels:"
    return f"{title}\n\n{markdown(columns, rows)}"


if __name__ == "__main__":
    main()
