"""Whether to trust a result: how well the motion explains the blurred picture, and what undoing it did.

A wrong PSF that was divided out and put back gives the input again, so re-blurring proves little. Two things tell
without a reference. The blurred picture's own spectra, as in :mod:`rsdeblur.timing`: under the right motion they are
likelier than under rivals, namely other sizes of the motion, its mirror image, its axes exchanged, and in each tile the
best of some straight blurs. And light below black: a wrong inverse leaves waves, and dark places cannot hold them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from rsdeblur._validate import FloatArray
from rsdeblur.errors import InputError
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion import BlurPaths, Motion, Shot
from rsdeblur.noise import noise_level
from rsdeblur.psf import PsfBank
from rsdeblur.stored import Stored
from rsdeblur.timing import TILE, Measured

Verdict = Literal["good", "doubtful", "bad"]

# Nats per tile that rivals may lead by, and light below black as a share of the picture's contrast: doubtful and bad.
# Chosen by looking at simulated captures; how often they are right: docs/developer/reliability.md.
DOUBTFUL_LEAD, BAD_LEAD = -4.0, -12.0
DOUBTFUL_RINGING, BAD_RINGING = 0.04, 0.08
# Where the motion leads every rival by this much, hard edges on black may ring twice as much.
CLEAR_LEAD = 10.0

# Tiles are looked at where the blur has at most this many px, up to so many along each axis of the picture.
REDUCED_BLUR = 16.0
MOST_TILES = 6
# A tile with the pixel before it, which its first differences need.
CELL = TILE + 1
# Shorter paths, px, cannot be told from a lens's softness.
SHORT = 3.0
# Rivals: the motion's size, and lengths (px) and directions of straight blurs.
SIZES = (0.5, 0.7, 1.4, 2.0)
LINES, DIRECTIONS = (3.0, 7.0, 15.0), 4

HINTS = {
    "still": "no blur at all.",
    "mirrored": "the motion mirrored: is one of the gyroscope's axes reversed?",
    "exchanged": "the motion with x and y exchanged: are the gyroscope's axes right?",
    "straight": "straight blurs of any direction: is it another moment's motion, or does the scene move?",
} | {
    f"{size:g} times": f"{size:g} times the motion: are the focal length and the unit of the rates right?"
    for size in SIZES
}


@dataclass(frozen=True, slots=True)
class Check:
    """What `deblur` found when it checked its result.

    Parameters
    ----------
    verdict : {"good", "doubtful", "bad"}
        Whether to trust the result.
    reasons : tuple of str
        Why, a sentence each; also what could not be judged.
    lead : float or None
        How much likelier the motion makes the blurred picture than its best rival does, in nats per tile; negative if
        the rival wins, None if that cannot be judged.
    rival : str or None
        That rival.
    ringing : float
        Light below black that deblurring made, root mean square, as a share of the picture's standard deviation.
    noise_gain : float or None
        Noise of the result over that of the input.
    residual : float or None
        Difference between the result blurred again and the input, root mean square, as a share of the picture's
        standard deviation; None where the PSF is too large for a tile, or the result straightened.
    leads, ringings : tuple of float
        The same in equal parts of the picture along the readout.
    blended : bool
        Whether the result was blended towards the input after this was found.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    lead: float | None
    rival: str | None
    ringing: float
    noise_gain: float | None
    residual: float | None
    leads: tuple[float, ...]
    ringings: tuple[float, ...]
    blended: bool = False


class Meter:
    """Gathers, slab by slab, how much light below black deblurring makes.

    Parameters
    ----------
    height : int
        Rows of the picture.
    """

    def __init__(self, height: int) -> None:
        self._part = np.minimum(np.arange(height) * MOST_TILES // height, MOST_TILES - 1)
        self._rows = np.zeros((4, height))

    def before(self, light: NDArray[np.float32], rows: slice) -> None:
        """Look at rows of the input."""
        self._rows[:3, rows] = light.mean((1, 2)), np.square(light).mean((1, 2)), _below_black(light)

    def after(self, light: NDArray[np.float32], rows: slice) -> None:
        """Look at rows of the result, before they are clipped."""
        self._rows[3, rows] = _below_black(light)

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


def judge(stored: Stored, result: Stored, shot: Shot, meter: Meter, *, motion: Motion, resampled: bool) -> Check:
    """Check a result.

    Parameters
    ----------
    stored, result : Stored
        The blurred picture and the sharp one, readout along y.
    shot : Shot
        The motion that was undone.
    meter : Meter
        What it saw of both.
    motion : {"rotation", "small-angle"}
        How paths are traced.
    resampled : bool
        Whether the result was straightened.
    """
    ringing, ringings = meter.ringing()
    reasons = []
    lead = rival = residual = gain = None
    leads: tuple[float, ...] = ()
    length = float(BlurPaths.probe(shot, motion=motion).lengths.mean())
    height, width, _ = stored.shape
    if length < SHORT:
        reasons.append(f"The motion explains {length:.1f} px of blur, too little to be judged.")
    elif min(height, width) < CELL:
        reasons.append(f"The picture is narrower than {CELL} px, too small to judge the motion by.")
    else:
        step = int(np.clip(length / REDUCED_BLUR, 1, max(1, min(height, width) // (3 * CELL))))
        tiles = _Tiles(stored, shot, step, motion)
        scores = tiles.rivals()
        rival = min(scores, key=lambda name: float(scores[name].sum()))
        leads = tuple(map(float, scores[rival].mean(axis=1)))
        lead = float(scores[rival].mean())
        gain = tiles.noise_gain(result)
        residual = None if resampled else tiles.residual(result)
        if lead < DOUBTFUL_LEAD:
            reasons.append(f"The motion does not fit. The picture is explained better by {HINTS[rival]}")
    allowance = 2.0 if lead is not None and lead > CLEAR_LEAD else 1.0
    if ringing > allowance * DOUBTFUL_RINGING:
        reasons.append(f"The result rings: light below black is {ringing:.1%} of the picture's contrast.")
    verdict = _verdict(lead, ringing / allowance)
    return Check(verdict, tuple(reasons), lead, rival, ringing, gain, residual, leads, ringings)


def _verdict(lead: float | None, ringing: float) -> Verdict:
    fit = np.inf if lead is None else lead
    if fit < BAD_LEAD or ringing > BAD_RINGING:
        return "bad"
    return "doubtful" if fit < DOUBTFUL_LEAD or ringing > DOUBTFUL_RINGING else "good"


class _Tiles:
    """Some tiles of a picture, reduced by a whole factor, with the PSFs there."""

    def __init__(self, stored: Stored, shot: Shot, step: int, motion: Motion) -> None:
        self._step, self._motion = step, motion
        self._corners = [_spread(n // step) for n in stored.shape[:2]]
        self._shot = replace(shot, camera=shot.camera.scaled(1 / step))
        self._blurred = self._cells(stored, step)
        self._noise = noise_level(_mosaic(self._cells(stored, 1))[..., None])
        self._bank = self._bank_of(self._shot)

    def _cells(self, stored: Stored, step: int) -> NDArray[np.float32]:
        """Read the tiles, each with a pixel before it, reduced by `step`; shape (B, S, CELL, CELL)."""
        tops, lefts = (corners * self._step for corners in self._corners)
        cells = np.empty((len(tops), len(lefts), CELL, CELL), dtype=np.float32)
        for b, top in enumerate(tops):
            light = stored.light(slice(top, top + CELL * step)).mean(axis=2)
            for s, left in enumerate(lefts):
                cell = light[:, left : left + CELL * step]
                cells[b, s] = cell.reshape(CELL, step, CELL, step).mean(axis=(1, 3))
        return cells

    def _bank_of(self, shot: Shot) -> PsfBank:
        rows, cols = (corners + (CELL + 1) / 2 for corners in self._corners)
        return PsfBank.from_paths(BlurPaths.from_shot(shot, rows, cols, motion=self._motion))

    def rivals(self) -> dict[str, FloatArray]:
        """Return how many nats likelier than under each rival the tiles are, shape (B, S)."""
        places = [np.arange(len(corners)) * CELL + 1 for corners in self._corners]
        measured = Measured(_mosaic(self._blurred), *places)
        kernels = self._bank.kernels
        turned = np.swapaxes(kernels, 2, 3)
        scores = {
            "mirrored": measured.fit(kernels[:, :, ::-1]),
            "exchanged": np.minimum(measured.fit(turned), measured.fit(turned[:, :, ::-1])),
            "still": measured.fit(np.ones((1, 1, 1, 1), dtype=np.float32)),
        }
        scores["straight"] = np.min([scores["still"], *(measured.fit(line) for line in _lines())], axis=0)
        camera = self._shot.camera
        for size in SIZES:
            longer = replace(camera, focal=(size * camera.focal[0], size * camera.focal[1]))
            scores[f"{size:g} times"] = measured.fit(self._bank_of(replace(self._shot, camera=longer)).kernels)
        claimed = measured.fit(kernels)
        return {name: score - claimed for name, score in scores.items()}

    def noise_gain(self, result: Stored) -> float | None:
        """Noise of the result over that of the input; None if that has none."""
        return noise_level(_mosaic(self._cells(result, 1))[..., None]) / self._noise if self._noise > 0 else None

    def residual(self, result: Stored) -> float | None:
        """Blur the result again and compare, where a tile holds all that is needed."""
        tall, wide = self._bank.size
        if max(tall, wide) > CELL // 2:
            return None
        inner = np.s_[..., tall // 2 : CELL - tall // 2, wide // 2 : CELL - wide // 2]
        again = fftconvolve(self._cells(result, self._step), self._bank.kernels, mode="valid", axes=(2, 3))
        contrast = max(float(self._blurred.std()), 1e-6)
        return float(np.sqrt(np.mean(np.square(again - self._blurred[inner])))) / contrast


def _spread(length: int) -> NDArray[np.intp]:
    """First pixels of tiles, with the one before, spread over `length` px; they do not overlap."""
    count = min(MOST_TILES, length // CELL)
    return np.round(np.linspace(0, length - CELL, count)).astype(np.intp)


def _mosaic(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    down, across = cells.shape[:2]
    return cells.swapaxes(1, 2).reshape(down * CELL, across * CELL)


def _lines() -> list[NDArray[np.float32]]:
    """Straight blurs, as kernels of shape (1, 1, k, k)."""
    along = np.linspace(-0.5, 0.5, 129)[:, None]
    half = int(max(LINES) // 2) + 1
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    paths = [length * along * (np.cos(angle), np.sin(angle)) for length in LINES for angle in angles]
    return [kernel[None, None] for kernel in rasterize(np.stack(paths), half, half)]


def fall_back(stored: Stored, check: Check, out: NDArray[Any]) -> Check:
    """Blend `out`, upright like the picture, towards the input where the check found it bad; light is blended."""
    height = stored.shape[0]
    share = np.maximum(
        _share(check.ringings, height, DOUBTFUL_RINGING, BAD_RINGING),
        _share(check.leads, height, DOUBTFUL_LEAD, BAD_LEAD),
    )
    sharp = Stored(out, stored.transfer)
    for top in range(0, height, CELL):
        rows = slice(top, min(top + CELL, height))
        if share[rows].any():
            weight = share[rows, None, None].astype(np.float32)
            stored.put(weight * stored.light(rows) + (1 - weight) * sharp.light(rows), rows, out)
    return replace(check, blended=True)


def _share(figures: tuple[float, ...], height: int, doubtful: float, bad: float) -> FloatArray:
    """Share of the input in every row, by figures in equal parts of the picture: 0 at `doubtful`, 1 at `bad`."""
    if not figures:
        return np.zeros(height)
    shares = ((np.array(figures) - doubtful) / (bad - doubtful)).clip(0.0, 1.0)
    centres = (np.arange(len(figures)) + 0.5) * height / len(figures) - 0.5
    each_row: FloatArray = np.interp(np.arange(height), centres, shares)
    return each_row


def refuse_fallback(geometry: str) -> None:
    """Raise `InputError` where the result and the input do not lie on each other."""
    if geometry == "rectify":
        raise InputError('fallback=True blends with the input, which geometry="rectify" straightens; use "keep"')
