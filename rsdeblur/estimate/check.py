"""Whether to trust a result: how well the motion explains the blurred picture, and what undoing it did.

A wrong PSF that was divided out and put back gives the input again, so re-blurring proves little. Two things tell
without a reference. First, the blurred picture's own spectra, as in :mod:`rsdeblur.estimate.time_offset`: under the
right motion they are likelier than under alternatives, namely other sizes of the motion, its mirror image, its axes
exchanged, straight blurs and none. Second, light below black: a wrong inverse leaves waves, and dark places cannot hold
them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

from rsdeblur.estimate.noise import noise_level
from rsdeblur.estimate.spectra import TILE, TilePeriodograms
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

Verdict = Literal["good", "doubtful", "bad"]

# Nats per tile that the best alternative may lead by, and light below black as a share of the picture's contrast:
# bounds of doubtful and bad. How they were chosen, and how often they are right: docs/developer/reliability.md.
DOUBTFUL_LEAD, BAD_LEAD = -1.5, -4.0
DOUBTFUL_RINGING, BAD_RINGING = 0.045, 0.09
# Where the motion leads every alternative by this much, hard edges on black may ring twice as much.
CLEAR_LEAD = 2.0

# No tile counts for more nats: the edge of a door is no proof of a straight blur.
MOST_NATS = 10.0
# Tiles are looked at where the blur has at most this many px, up to so many along each axis of the picture.
REDUCED_BLUR = 16.0
MOST_TILES = 6
# Standard deviation of a picture over that of its noise: below there is nothing but noise.
LEAST_DETAIL = 2.0
# A tile with the pixel before it, which its first differences need.
CELL = TILE + 1
# Shorter paths, px, cannot be told from a lens's softness.
SHORT = 3.0
# Alternatives: the motion's size, and lengths (px) and directions of straight blurs.
SIZES = (0.5, 0.7, 1.4, 2.0)
LINES, DIRECTIONS = (3.0, 7.0, 15.0), 4
# What the scene's power may be, as multiples of its mean, which strong edges dominate. The noise is what it is: with
# less of it allowed, short blurs explain noise as detail.
GAINS = np.exp(np.linspace(-2.5, -0.4, 4)).astype(np.float32)
NOISES = np.ones(1, dtype=np.float32)
# Rows between those whose light below black is looked at, in pictures of 64 such steps or more.
ROW_STEP = 8

# Motion that is too small undoes too little, and hardly does harm.
LARGER = tuple(f"{size:g} times" for size in SIZES if size > 1)

HINTS = {
    "still": "no blur at all.",
    "mirrored": "the motion mirrored: is one of the gyroscope's axes reversed?",
    "exchanged": "the motion with x and y exchanged: are the gyroscope's axes right?",
    "straight": "a straight blur: is it another moment's motion, or does the scene move?",
} | {
    f"{size:g} times": f"{size:g} times the motion: are the focal length and the unit of the rates right?"
    for size in SIZES
}


@dataclass(frozen=True, slots=True)
class QualityCheck:
    """What `deblur` found when it checked its result.

    Parameters
    ----------
    verdict : {"good", "doubtful", "bad"}
        Whether to trust the result.
    reasons : tuple of str
        Why, a sentence each; also what could not be judged.
    lead : float or None
        How much likelier the motion makes the blurred picture than its best alternative does, in nats per tile, at most
        10 in each; negative if the alternative wins, None if that cannot be judged.
    alternative : str or None
        That alternative, but not the motion enlarged where another one makes the result bad.
    weakest : float or None
        The same in the two neighbouring rows of tiles that the motion fits worst. It says where to look, and does not
        count: in parts of a picture the scene itself may look like an alternative.
    ringing : float
        Light below black that deblurring made, root mean square, as a share of the picture's standard deviation.
    noise_gain : float or None
        Noise of the result over that of the input.
    residual : float or None
        Difference between the result blurred again and the input, root mean square, as a share of the picture's
        standard deviation; None where the PSF is too large for a tile, or the result straightened.
    leads, ringings : tuple of float
        The same in equal parts of the picture along the readout, each against the alternative that is best there, the
        enlarged motion left out.
    blended : bool
        Whether the result was blended towards the input after this was found.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    lead: float | None
    alternative: str | None
    weakest: float | None
    ringing: float
    noise_gain: float | None
    residual: float | None
    leads: tuple[float, ...]
    ringings: tuple[float, ...]
    blended: bool = False


class UndershootMeter:
    """Gathers, slab by slab, how much light below black deblurring makes.

    Parameters
    ----------
    height : int
        Rows of the picture.
    """

    def __init__(self, height: int) -> None:
        self._step = int(np.clip(height // 64, 1, ROW_STEP))
        # The frame's first row rings more than others.
        self._first = self._step // 2
        self._part = np.arange(self._first, height, self._step) * MOST_TILES // height
        self._rows = np.zeros((4, len(self._part)))

    def before(self, light: NDArray[np.float32], rows: slice) -> None:
        """Look at rows of the input."""
        light, at = self._some(light, rows)
        self._rows[:3, at] = light.mean((1, 2)), np.square(light).mean((1, 2)), _below_black(light)

    def after(self, light: NDArray[np.float32], rows: slice) -> None:
        """Look at rows of the result, before they are clipped."""
        light, at = self._some(light, rows)
        self._rows[3, at] = _below_black(light)

    def _some(self, light: NDArray[np.float32], rows: slice) -> tuple[NDArray[np.float32], slice]:
        first, stop = (-(-(row - self._first) // self._step) for row in (rows.start, rows.stop))
        return light[first * self._step + self._first - rows.start :: self._step], slice(first, stop)

    def ringing(self) -> tuple[float, tuple[float, ...]]:
        """Return the ringing of the picture and of its parts."""
        mean, square, before, after = self._rows
        contrast = max(float(square.mean() - mean.mean() ** 2), 1e-12)
        gained = (after - before) / contrast
        parts = [gained[self._part == part] for part in range(MOST_TILES)]
        whole, *each = (np.sqrt(max(float(np.mean(part)), 0.0)) if part.size else 0.0 for part in (gained, *parts))
        return float(whole), tuple(map(float, each))


def _below_black(light: NDArray[np.float32]) -> FloatArray:
    below: FloatArray = np.square(np.minimum(light, 0.0)).mean((1, 2)).astype(np.float64)
    return below


def assess(
    encoded: EncodedImage,
    result: EncodedImage,
    capture: Capture,
    meter: UndershootMeter,
    *,
    resampled: bool,
    threads: int | None = None,
) -> QualityCheck:
    """Check a result.

    Parameters
    ----------
    stored, result : Stored
        The blurred picture and the sharp one, readout along y.
    capture : Capture
        The motion that was undone.
    meter : Meter
        What it saw of both.
    resampled : bool
        Whether the result was straightened.
    threads : int, optional
        Threads that draw PSFs; default all processors.

    Returns
    -------
    Check
    """
    ringing, ringings = meter.ringing()
    found = QualityCheck("good", (), None, None, None, ringing, None, None, (), ringings)
    length = float(capture.probe.lengths.mean())
    height, width, _ = encoded.shape
    if length < SHORT:
        return _judged(found, f"The motion explains {length:.1f} px of blur, too little to be judged.")
    if min(height, width) < CELL:
        reason = f"The picture is narrower than {CELL} px, too small to judge the motion by."
        return replace(_judged(found, reason), verdict="bad" if ringing > BAD_RINGING else "doubtful")
    step = int(np.clip(length / REDUCED_BLUR, 1, max(1, min(height, width) // (2 * CELL))))
    tiles = _Tiles(encoded, capture, step, threads)
    if not tiles.detailed:
        return _judged(found, "The picture shows no detail to judge the motion by.")
    scores = tiles.alternatives()
    means = {name: float(score.mean()) for name, score in scores.items()}
    harmful = {name: mean for name, mean in means.items() if name not in LARGER}
    alternative = min(harmful if min(harmful.values()) < BAD_LEAD else means, key=means.__getitem__)
    gain, residual = tiles.compare(result, resampled=resampled)
    found = replace(
        found,
        lead=means[alternative],
        alternative=alternative,
        weakest=min(float(_neighbouring(score).min()) for score in scores.values()),
        noise_gain=gain,
        residual=residual,
        leads=tuple(map(float, np.min([scores[name] for name in harmful], axis=0))),
    )
    return _judged(found)


def _judged(found: QualityCheck, *reasons: str) -> QualityCheck:
    """Derive the verdict and its reasons from the figures."""
    lead = np.inf if found.lead is None else found.lead
    ringing = found.ringing / (2.0 if CLEAR_LEAD < lead < np.inf else 1.0)
    bad = (lead < BAD_LEAD and found.alternative not in LARGER) or ringing > BAD_RINGING
    said = list(reasons)
    if lead < DOUBTFUL_LEAD and found.alternative is not None:
        said.append(
            f"The motion {'does' if bad else 'may'} not fit. The picture is explained better by "
            f"{HINTS[found.alternative]}"
        )
    if ringing > DOUBTFUL_RINGING:
        said.append(f"The result rings: light below black is {found.ringing:.1%} of the picture's contrast.")
    doubtful = len(said) > len(reasons)
    return replace(found, verdict="bad" if bad else "doubtful" if doubtful else "good", reasons=tuple(said))


def _neighbouring(score: FloatArray) -> FloatArray:
    """Means of neighbouring rows of tiles."""
    return (score[1:] + score[:-1]) / 2 if len(score) > 1 else score


class _Tiles:
    """Some tiles of a picture, reduced by a whole factor, with the PSFs there; colours are averaged."""

    def __init__(self, encoded: EncodedImage, capture: Capture, step: int, threads: int | None) -> None:
        self._step, self._threads = step, threads
        self._corners = [_spread(n // step) for n in encoded.shape[:2]]
        self._blurred, finest = self._cells(encoded)
        self._noise = noise_level(_mosaic(finest)[..., None])
        rows, cols = (corners + (CELL + 1) / 2 for corners in self._corners)
        smaller = replace(capture, camera=capture.camera.scaled(1 / step))
        self._paths = BlurPaths.from_capture(smaller, rows, cols)
        self._kernels = PsfBank.from_paths(self._paths, threads=threads).kernels

    @property
    def detailed(self) -> bool:
        """Whether the tiles show more than noise, which reducing them made weaker."""
        return float(self._blurred.std()) > max(LEAST_DETAIL * self._noise / self._step, 1e-6)

    def _cells(self, encoded: EncodedImage) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Read the tiles, each with a pixel before it: reduced, and as much unreduced; shape (B, S, CELL, CELL)."""
        tops, lefts = (corners * self._step for corners in self._corners)
        reduced, finest = np.empty((2, len(tops), len(lefts), CELL, CELL), dtype=np.float32)
        channels, side = encoded.shape[2], CELL * self._step
        for b, top in enumerate(tops):
            for s, left in enumerate(lefts):
                values = encoded.values[top : top + side, left : left + side, :channels]
                cell = EncodedImage(values, encoded.transfer).linear(slice(None)) @ np.full(
                    channels, 1 / channels, np.float32
                )
                finest[b, s] = cell[:CELL, :CELL]
                reduced[b, s] = cell.reshape(CELL, self._step, CELL, self._step).mean(axis=(1, 3))
        return reduced, finest

    def alternatives(self) -> dict[str, FloatArray]:
        """Return the lead of the motion over each alternative in nats, mean of each row of tiles, shape (B,)."""
        places = [np.arange(len(corners)) * CELL + 1 for corners in self._corners]
        fit = partial(TilePeriodograms(_mosaic(self._blurred), *places).fit, gains=GAINS, noises=NOISES)
        claimed = fit(self._kernels)

        def lead(kernels: NDArray[np.float32]) -> FloatArray:
            each_row: FloatArray = (fit(kernels) - claimed).clip(-MOST_NATS, MOST_NATS).mean(axis=1)
            return each_row

        def best(kernels: Iterable[NDArray[np.float32]]) -> FloatArray:
            return min(map(lead, kernels), key=lambda score: float(score.sum()))

        turned = np.swapaxes(self._kernels, 2, 3)
        still = np.ones((1, 1, 1, 1), dtype=np.float32)
        sized = {size: replace(self._paths, displacements=size * self._paths.displacements) for size in SIZES}
        return {
            "mirrored": lead(self._kernels[:, :, ::-1]),
            "exchanged": best((turned, turned[:, :, ::-1])),
            "still": lead(still),
            "straight": best(_lines(self._threads)),
            **{
                f"{size:g} times": lead(PsfBank.from_paths(paths, threads=self._threads).kernels)
                for size, paths in sized.items()
            },
        }

    def compare(self, result: EncodedImage, *, resampled: bool) -> tuple[float | None, float | None]:
        """Return the result's noise over the input's, and how far the result blurred again is from the input."""
        sharp, finest = self._cells(result)
        gain = noise_level(_mosaic(finest)[..., None]) / self._noise if self._noise > 0 else None
        return gain, None if resampled else self._residual(sharp)

    def _residual(self, sharp: NDArray[np.float32]) -> float | None:
        """Compare where a tile holds all that is needed."""
        tall, wide = self._kernels.shape[2:]
        if max(tall, wide) > TILE // 2:
            return None
        spectra = rfft2(sharp, (TILE, TILE)) * rfft2(self._kernels, (TILE, TILE))
        # What the periodic convolution holds for pixels whose neighbours all lie in the tile.
        again = irfft2(spectra, (TILE, TILE))[..., tall - 1 :, wide - 1 :]
        inner = np.s_[..., tall // 2 : TILE - tall // 2, wide // 2 : TILE - wide // 2]
        difference = float(np.sqrt(np.mean(np.square(again - self._blurred[inner]))))
        return difference / float(self._blurred.std())


def _spread(length: int) -> NDArray[np.intp]:
    """First pixels of tiles, with the one before, spread over `length` px; they overlap by half at most."""
    count = min(MOST_TILES, 2 * length // CELL - 1)
    return np.round(np.linspace(0, length - CELL, count)).astype(np.intp)


def _mosaic(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    down, across = cells.shape[:2]
    return cells.swapaxes(1, 2).reshape(down * CELL, across * CELL)


def _lines(threads: int | None) -> list[NDArray[np.float32]]:
    """Straight blurs, as kernels of shape (1, 1, k, k)."""
    along = np.linspace(-0.5, 0.5, 129)[:, None]
    half = int(max(LINES) // 2) + 1
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    paths = [length * along * (np.cos(angle), np.sin(angle)) for length in LINES for angle in angles]
    return [kernel[None, None] for kernel in rasterize(np.stack(paths), half, half, threads)]


def fall_back(encoded: EncodedImage, check: QualityCheck, out: NDArray[Any]) -> QualityCheck:
    """Blend `out`, upright like the picture, towards the input where the check found it bad; light is blended."""
    height = encoded.shape[0]
    share = np.maximum(
        _share(check.ringings, height, DOUBTFUL_RINGING, BAD_RINGING),
        _share(check.leads, height, DOUBTFUL_LEAD, BAD_LEAD),
    )
    sharp = EncodedImage(out, encoded.transfer)
    for top in range(0, height, CELL):
        rows = slice(top, min(top + CELL, height))
        if share[rows].any():
            weight = share[rows, None, None].astype(np.float32)
            encoded.encode(weight * encoded.linear(rows) + (1 - weight) * sharp.linear(rows), rows, out)
    return replace(check, blended=True)


def _share(figures: tuple[float, ...], height: int, doubtful: float, bad: float) -> FloatArray:
    """Share of the input in every row, by figures in equal parts of the picture: 0 at `doubtful`, 1 at `bad`."""
    if not figures:
        return np.zeros(height)
    shares = ((np.array(figures) - doubtful) / (bad - doubtful)).clip(0.0, 1.0)
    centres = (np.arange(len(figures)) + 0.5) * height / len(figures) - 0.5
    each_row: FloatArray = np.interp(np.arange(height), centres, shares)
    return each_row
