"""Cost of tiles in quality: ``python -m benchmarks.tiles [--captures N] [--markdown FILE]``.

The engine is compared with the method that it approximates: in double precision, the filter of every tile is applied to
the whole picture, whose continuation is as long as the margin of a tile, and the results are interpolated linearly.
Differences in PSNR come from the finite tiles alone. Then two constants are changed: the margin, and the overlap of the
windows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from rich.progress import track

from benchmarks.captures import QUICK, SimulatedCapture, quality, simulated
from benchmarks.cases import centred
from benchmarks.data import Image, noted
from benchmarks.tables import markdown, report
from rsdeblur import Deconvolver, PsfBank
from rsdeblur.deconv import tiling, wiener
from rsdeblur.deconv.tiling import fade
from rsdeblur.pipeline.deblur import psfs

# (standard deviation of the noise, an NSR that suits it)
NOISES = ((0.01, 0.03), (0.003, 0.01), (0.001, 0.003))
TILES = ((1, 1), (4, 1), (16, 1), (64, 1), (16, 4))
SEED = 1
Plane = NDArray[np.float64]
Weights = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=6, help="only the first N of the 14 captures (6)")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    parser.add_argument("--quick", action="store_true", help="one small capture, to see that it runs")
    options = parser.parse_args()
    count, enlarged = (1, QUICK) if options.quick else (options.captures, 2)
    captures = list(simulated(count, noise=0.0, enlarged=enlarged))
    report(noted(run(captures, TILES[:3] if options.quick else TILES)), options.markdown)


def run(captures: Sequence[SimulatedCapture], tiles: Sequence[tuple[int, int]]) -> str:
    """Return the tables as Markdown."""
    rows = []
    for capture, (noise, nsr), (bands, strips) in track(
        [(c, n, t) for c in captures for n in NOISES for t in tiles], "whole-picture filters, margins, windows"
    ):
        shape = capture.pictures.blurred.shape
        drawn = np.random.default_rng(SEED).normal(scale=noise, size=shape).astype(np.float32)
        blurred = capture.pictures.blurred + drawn
        bank = psfs(*capture.recording, bands=bands, strips=strips, nsr=nsr)
        images = {"whole": whole(bank, blurred, nsr)} | dict(variants(bank, blurred, nsr))
        scores = {name: quality(capture.pictures.rolling, image)[0] for name, image in images.items()}
        rows.append(((noise, nsr), (bands, strips), scores))
    names = [name for name in rows[0][2] if name != "whole"]
    head = ["noise, NSR", "tiles", "whole picture, dB", *(f"{name}: mean (worst)" for name in names)]
    lines = []
    for at in NOISES:
        for count in tiles:
            chosen = [scores for where, tiled, scores in rows if (where, tiled) == (at, count)]
            lost = [np.array([s[name] - s["whole"] for s in chosen]) for name in names]
            mean = np.mean([s["whole"] for s in chosen])
            cells = [f"{d.mean():+.3f} ({d.min():+.3f})" for d in lost]
            lines.append([f"{at[0]}, {at[1]}", f"{count[0]} x {count[1]}", f"{mean:.2f}", *cells])
    return "PSNR of the engine minus that of filters of the whole picture, dB.\n\n" + markdown(head, lines)


def variants(bank: PsfBank, blurred: Image, nsr: float) -> Iterator[tuple[str, Image]]:
    """Yield the results of the engine, unchanged and with one constant changed."""
    plain = tiling.hat_weights
    changes: dict[str, list[tuple[object, str, object]]] = {
        "engine": [],
        "half the margin": [
            (wiener, "LEAST_MARGIN", wiener.LEAST_MARGIN / 2),
            (wiener, "DECAY_MARGIN", wiener.DECAY_MARGIN / 2),
        ],
        "twice the margin": [
            (wiener, "LEAST_MARGIN", wiener.LEAST_MARGIN * 2),
            (wiener, "DECAY_MARGIN", wiener.DECAY_MARGIN * 2),
        ],
        "half the overlap": [(tiling, "hat_weights", partial(_narrower, plain, 0.5))],
        "a quarter of the overlap": [(tiling, "hat_weights", partial(_narrower, plain, 0.25))],
    }
    for name, moved in changes.items():
        with ExitStack() as stack:
            for module, constant, value in moved:
                stack.enter_context(patch.object(module, constant, value))
            yield name, Deconvolver(bank, blurred.shape, nsr=nsr).apply(blurred)


def _narrower(plain: Weights, overlap: float, centres: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Return weights that change within a share `overlap` of the distance between centres, in its middle."""
    steeper = ((plain(centres, n) - 0.5) / overlap + 0.5).clip(0.0, 1.0)
    narrowed: NDArray[np.float64] = steeper / steeper.sum(axis=0)
    return narrowed


def whole(bank: PsfBank, blurred: Image, nsr: float) -> Image:
    """Return the picture filtered whole with every kernel of the bank, interpolated, in double precision."""
    height, width, _ = blurred.shape
    margin = max(wiener.LEAST_MARGIN, wiener.DECAY_MARGIN / nsr**0.5)
    needed = (int(n + margin * kernel) for n, kernel in zip((height, width), bank.size, strict=True))
    sizes = tuple(scipy.fft.next_fast_len(n, real=True) for n in needed)
    extended = _continued(_continued(blurred.astype(np.float64), sizes[0]).swapaxes(0, 1), sizes[1]).swapaxes(0, 1)
    spectrum = scipy.fft.rfft2(extended, axes=(0, 1))
    down, across = tiling.hat_weights(bank.rows, height), tiling.hat_weights(bank.cols, width)
    out = np.zeros(blurred.shape)
    for b, s in np.ndindex(*bank.kernels.shape[:2]):
        otf = scipy.fft.rfft2(centred(bank.kernels[b, s], sizes).astype(np.float64))[:, :, None]
        restored = (1 + nsr) * np.conj(otf) / (np.abs(otf) ** 2 + nsr) * spectrum
        sharp = scipy.fft.irfft2(restored, s=sizes, axes=(0, 1))[:height, :width]
        out += (down[b][:, None] * across[s])[:, :, None] * sharp
    return out.astype(np.float32)


def _continued(picture: Plane, length: int) -> Plane:
    """Return a picture continued along its first axis: the reflection at one end fades into that at the other."""
    beyond = length - len(picture)
    after = np.pad(picture, ((0, beyond), (0, 0), (0, 0)), mode="symmetric")[len(picture) :]
    before = np.pad(picture, ((beyond, 0), (0, 0), (0, 0)), mode="symmetric")[:beyond]
    share = fade(beyond).astype(np.float64)[:, None, None]
    return np.concatenate([picture, (1 - share) * after + share * before])


if __name__ == "__main__":
    main()
