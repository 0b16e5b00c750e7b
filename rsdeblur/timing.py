"""The clock offset between gyroscope and camera, from one blurred picture.

No picture is deblurred for it. A blur leaves its own spectrum in the picture: zeros where the PSF has zeros. Each
candidate offset predicts a PSF for every part of the picture, hence how much power each part has at each frequency, and
the offset under which the measured spectra are likeliest wins. The rolling shutter helps: every band judges another
stretch of the log.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import ArrayLike, NDArray
from skimage.transform import resize

from rsdeblur import _validate
from rsdeblur._atomic import atomic_write
from rsdeblur._validate import FloatArray
from rsdeblur.camera import Camera
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.exposure import Exposure
from rsdeblur.gyro import GyroLog
from rsdeblur.motion import BlurPaths, Shot
from rsdeblur.psf import PsfBank
from rsdeblur.stored import Stored, check_size
from rsdeblur.transfer import Transfer, check_transfer

# Side of the tiles whose spectra are compared, px, and how far they overlap. Small ones keep the PSF constant within.
TILE = 64
# Longer side of the reduced picture in the coarse and in the fine search, px, and the steps there, s.
COARSE_SIDE, COARSE_STEP = 320, 4e-3
FINE_SIDE, FINE_STEP = 640, 1e-3
# Minima of the coarse curve that are looked at again.
MINIMA = 6
# Offsets nearer than this count as the same answer, s.
SAME = 4e-3

# Part of the frequencies that is compared, cycles/px: below, the window smears; above, there are corners only.
LOWEST, HIGHEST = 1.5 / TILE, 0.5
# Frequencies that mostly hold noise; it is the weakest of eight directions there, and signal elsewhere.
NOISE_BAND = 0.35, 0.5
DIRECTIONS = 8
# What the power of the scene and of the noise may be, as multiples of the first estimates.
GAINS = np.exp(np.linspace(-2.5, 2.5, 8)).astype(np.float32)
NOISES = np.array([0.3, 1.0], dtype=np.float32)
# Weight of outliers: power far above what is expected, as along a strong edge, counts by its logarithm.
TAIL = np.float32(2.0)

RESAMPLES = 200
# Least lead over any other answer, in nats over the whole picture: a constant rate gives every offset the same PSF.
LEAST_LEAD = 30.0
CONFIDENT = 0.8

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, eq=False)
class OffsetSearch:
    """What `find_time_offset` found.

    Parameters
    ----------
    time_offset : float or None
        The camera's new `time_offset`, s; None if the picture cannot tell.
    best : float
        The likeliest offset, s, trusted or not.
    confidence : float
        Share, in [0, 1], of resamplings of the picture's parts that give the same answer.
    reason : str
        Why there is no answer; empty if there is one.
    offsets : ndarray, shape (n,)
        Candidates of the fine search, s, increasing.
    scores : ndarray, shape (n,)
        Negative log-likelihood of each, in nats above the best.
    """

    time_offset: float | None
    best: float
    confidence: float
    reason: str
    offsets: FloatArray
    scores: FloatArray


def find_time_offset(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    search: tuple[float, float] = (-0.06, 0.06),
    transfer: Transfer = "linear",
    progress: Progress | None = None,
) -> OffsetSearch:
    """Find the time offset under which the picture's spectra are likeliest.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        The blurred picture, as for :func:`rsdeblur.deblur`.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    search : (float, float)
        First and last candidate relative to `camera.time_offset`, s. Candidates that the log does not cover are left
        out.
    transfer : {"linear", "srgb"} or float
        How stored values code light.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    OffsetSearch
        Its `time_offset` is None where the answer changes with the part of the picture that is asked.

    Raises
    ------
    InputError
        If an argument is out of range, or the picture is too small.
    CoverageError, ClockError, GapError
        If the log covers no candidate.

    Notes
    -----
    A periodogram is distributed exponentially about its mean, so its negative log-likelihood is
    `sum log V + P / V` (Whittle 1953) with `V = a S |H|^2 + b N`: S the scene's spectrum, whose gradients are taken as
    white, N the noise's, and a, b free in every tile.
    """
    first, last = (_validate.finite("search", end) for end in search)
    if last - first < 2 * COARSE_STEP:
        raise InputError(f"search must span at least {2 * COARSE_STEP:g} s, got {first:g} to {last:g}")
    stored = Stored.of(image, check_transfer(transfer), quarter=False)
    check_size(stored.shape, camera)
    light = stored.light(slice(None)).mean(2)

    capture = log, camera, exposure
    whole = np.arange(0, round((last - first) / FINE_STEP) + 1, round(COARSE_STEP / FINE_STEP))
    coarse = _Curve(TileSpectra(light, camera, side=COARSE_SIDE), capture, first)
    coarse.extend(whole, lambda done: progress and progress("coarse", done))
    fine = _Curve(TileSpectra(light, camera, side=FINE_SIDE), capture, first)
    wanted = _windows(coarse.minima()[:MINIMA], whole[-1])
    while len(wanted):
        fine.extend(wanted, lambda done: progress and progress("fine", done))
        # The minimum may lie beside the window that the coarse curve chose.
        wanted = np.setdiff1d(_windows(fine.minima()[:1], whole[-1]), fine.tried)
        wanted = wanted if fine.at_edge() else wanted[:0]
    return fine.judged()


def _windows(places: NDArray[np.intp], last: int) -> NDArray[np.intp]:
    """Return all fine steps within a coarse one of `places`, from 0 to `last`."""
    reach = round(COARSE_STEP / FINE_STEP)
    near = np.unique(places[:, None] + np.arange(-reach, reach + 1))
    return near[(near >= 0) & (near <= last)]


class _Curve:
    """Scores of all tiles over the candidates tried so far; candidate k is shifted by `first + k FINE_STEP`."""

    def __init__(self, spectra: TileSpectra, capture: tuple[GyroLog, Camera, Exposure], first: float) -> None:
        self._spectra, self._capture, self._first = spectra, capture, first
        self._scores: dict[int, FloatArray] = {}
        self.tried: list[int] = []

    def extend(self, places: NDArray[np.intp], progress: Callable[[float], object]) -> None:
        """Score candidates; those that the log does not cover are left out, unless none is left."""
        log, camera, exposure = self._capture
        refused: CoverageError | None = None
        for i, place in enumerate(places.tolist()):
            progress(i / len(places))
            self.tried.append(place)
            moved = replace(camera, time_offset=camera.time_offset + self._first + place * FINE_STEP)
            try:
                self._scores[place] = self._spectra.score(log, moved, exposure)
            except CoverageError as error:
                refused = error
        if refused and not self._scores:
            raise refused

    def _table(self) -> tuple[NDArray[np.intp], FloatArray]:
        places = np.array(sorted(self._scores))
        return places, np.array([self._scores[place] for place in places.tolist()])

    def minima(self) -> NDArray[np.intp]:
        """Places of the local minima, the deepest first."""
        places, tiles = self._table()
        total = np.pad(tiles.sum(axis=1), 1, constant_values=np.inf)
        (found,) = np.nonzero((total[1:-1] <= total[:-2]) & (total[1:-1] <= total[2:]))
        return places[found[np.argsort(total[1:-1][found])]]

    def at_edge(self) -> bool:
        """Whether a neighbour of the best candidate is unknown."""
        best = int(self.minima()[0])
        return best - 1 not in self._scores or best + 1 not in self._scores

    def judged(self) -> OffsetSearch:
        """Weigh the answer by resampling the tiles."""
        places, tiles = self._table()
        total = tiles.sum(axis=1)
        at = int(total.argmin())
        edge = self.at_edge()
        origin = self._capture[1].time_offset + self._first
        best = origin + float(places[at] + (0.0 if edge else _vertex(total[at - 1 : at + 2]))) * FINE_STEP
        far = np.abs(places - places[at]) * FINE_STEP > SAME
        # As many draws from the tiles as there are, with repetition: what would the next picture have said?
        count = tiles.shape[1]
        draws = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLES)
        resampled = draws @ tiles.T
        lead = np.min(resampled[:, far], axis=1, initial=np.inf) - resampled[:, ~far].min(axis=1)
        confidence = float(np.mean(lead > LEAST_LEAD))
        reason = ""
        if edge:
            reason = "the likeliest offset lies at the end of the search, or of the log; widen it"
        elif confidence < CONFIDENT:
            reason = "parts of the picture disagree: the motion is too uniform, or the scene without detail"
        answer = None if reason else best
        return OffsetSearch(
            answer, best, confidence, reason, origin + places * np.float64(FINE_STEP), total - total[at]
        )


def _vertex(scores: FloatArray) -> float:
    """Offset in steps from the middle of three scores to the vertex of the parabola through them."""
    before, here, after = scores
    bend = before - 2 * here + after
    return 0.5 * float((before - after) / bend) if bend > 0 else 0.0


class TileSpectra:
    """Power spectra of the parts of a blurred picture, and how likely they are under a camera's motion.

    Parameters
    ----------
    light : ndarray, shape (H, W)
        Linear light.
    camera : Camera
        Of the picture; scores may be asked for other clocks and focal lengths, not for another size.
    side : int
        The picture is reduced until its longer side has this many px.

    Raises
    ------
    InputError
        If the reduced picture is smaller than a tile.
    """

    def __init__(self, light: NDArray[np.float32], camera: Camera, *, side: int) -> None:
        self._scale = min(1.0, side / max(light.shape))
        small = camera.scaled(self._scale)
        if min(small.width, small.height) < TILE:
            raise InputError(f"the picture must keep {TILE} px on its shorter side when its longer one has {side} px")
        grey = light
        if self._scale < 1:
            grey = resize(light, (small.height, small.width), order=1, anti_aliasing=True)
        self._quarter = camera.horizontal_readout
        grey = np.rot90(grey, -1) if self._quarter else grey
        tops, lefts = (_places(n) for n in grey.shape)
        self._rows, self._cols = tops + (TILE - 1) / 2, lefts + (TILE - 1) / 2
        self._measured = Measured(grey, tops, lefts)

    def score(self, log: GyroLog, camera: Camera, exposure: Exposure) -> FloatArray:
        """Return the negative log-likelihood, in nats, of every tile under this motion.

        Raises
        ------
        CoverageError, ClockError, GapError
            If the log does not describe the exposure.
        """
        small = camera.scaled(self._scale)
        shot = Shot.from_log(log, small.turned() if self._quarter else small, exposure)
        bank = PsfBank.from_paths(BlurPaths.from_shot(shot, self._rows, self._cols))
        return self._measured.fit(bank.kernels).ravel()


class Measured:
    """Periodograms of tiles of a picture, and how likely they are under given PSFs.

    Parameters
    ----------
    grey : ndarray, shape (H, W)
        Linear light.
    tops, lefts : ndarray, shape (B,) and (S,)
        First pixels of the tiles.
    """

    def __init__(self, grey: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp]) -> None:
        fy, fx = np.meshgrid(scipy.fft.fftfreq(TILE), scipy.fft.rfftfreq(TILE), indexing="ij")
        radius = np.hypot(fx, fy)
        self._used = (radius > LOWEST) & (radius < HIGHEST)
        # Response of the two differences together.
        gradient = 4 * np.sin(np.pi * fy) ** 2 + 4 * np.sin(np.pi * fx) ** 2
        power = _periodograms(grey, tops, lefts)
        self._noise = _noise(power, gradient, fy, fx)[..., None] * gradient[self._used].astype(np.float32)
        self._power = power[..., self._used]
        self._scene = (gradient / np.maximum(radius, LOWEST) ** 2).astype(np.float32)

    def fit(
        self,
        kernels: NDArray[np.float32],
        *,
        gains: NDArray[np.float32] = GAINS,
        noises: NDArray[np.float32] = NOISES,
    ) -> FloatArray:
        """Return the negative log-likelihood, in nats, of the tiles under `kernels` (B or 1, S or 1, kh, kw)."""
        expected = (_power_of(kernels) * self._scene)[..., self._used]
        excess = (self._power - self._noise).mean(axis=-1).clip(1e-12)
        scene = (excess / expected.mean(axis=-1))[..., None] * expected
        likeliest = np.full(excess.shape, np.inf, dtype=np.float32)
        for noise in noises:
            for gain in gains:
                variance = gain * scene + noise * self._noise
                surprise = np.log(variance) + TAIL * np.log1p(self._power / (TAIL * variance))
                np.minimum(likeliest, surprise.sum(axis=-1), out=likeliest)
        return likeliest.astype(np.float64)


def _places(n: int) -> NDArray[np.intp]:
    """First pixels of tiles that overlap by half and span `n` px."""
    return np.round(np.linspace(0, n - TILE, -(-2 * (n - TILE) // TILE) + 1)).astype(np.intp)


def _periodograms(grey: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp]) -> NDArray[np.float32]:
    """Power of both differences in every tile under a Hann window, shape (B, S, TILE, TILE // 2 + 1)."""
    hann = np.sin(np.pi * np.arange(TILE) / TILE) ** 2
    window = (np.outer(hann, hann) / np.sum(hann**2)).astype(np.float32)
    power = np.zeros((len(tops), len(lefts), TILE, TILE // 2 + 1), dtype=np.float32)
    for axis in (0, 1):
        difference = np.diff(grey, axis=axis, prepend=np.take(grey, [0], axis=axis)).astype(np.float32)
        tiles = np.lib.stride_tricks.sliding_window_view(difference, (TILE, TILE))[np.ix_(tops, lefts)]
        power += np.abs(scipy.fft.rfft2(tiles * window)) ** 2
    return power


def _noise(power: NDArray[np.float32], gradient: FloatArray, fy: FloatArray, fx: FloatArray) -> NDArray[np.float32]:
    """Power of white noise per tile: the least of several directions at high frequencies."""
    radius, angle = np.hypot(fy, fx), np.arctan2(fy, fx) / np.pi + 0.5
    high = (radius > NOISE_BAND[0]) & (radius < NOISE_BAND[1])
    white = power / np.maximum(gradient, 1e-9)
    sectors = [high & (np.minimum(angle * DIRECTIONS // 1, DIRECTIONS - 1) == k) for k in range(DIRECTIONS)]
    least: NDArray[np.float32] = np.min([white[..., sector].mean(axis=-1) for sector in sectors], axis=0)
    return np.maximum(least, 1e-12).astype(np.float32)


def _power_of(kernels: NDArray[np.float32]) -> NDArray[np.float32]:
    """|H|^2 as the window shows it, shape (B, S, TILE, TILE // 2 + 1)."""
    tall, wide = kernels.shape[2:]
    # A PSF larger than a tile wraps: its spectrum is sampled as finely as the picture's.
    down, across = (-(-n // TILE) for n in (tall, wide))
    room = ((0, 0), (0, 0), (0, down * TILE - tall), (0, across * TILE - wide))
    kernels = np.pad(kernels, room).reshape(*kernels.shape[:2], down, TILE, across, TILE).sum(axis=(2, 4))
    power: NDArray[Any] = np.abs(scipy.fft.fft2(kernels)) ** 2
    for axis in (2, 3):
        # The power of a Hann window's transform: 1/6, 2/3, 1/6.
        power = power * (2 / 3) + (np.roll(power, 1, axis) + np.roll(power, -1, axis)) / 6
    return power[..., : TILE // 2 + 1]


def write_time_offset(path: str | os.PathLike[str], time_offset: float) -> None:
    """Put `time_offset`, s, into a camera file, whose other lines stay as they are; it is replaced atomically.

    Raises
    ------
    FileFormatError
        If the file is not a camera file.
    OutputError
        If it cannot be written.
    """
    time_offset = _validate.finite("time_offset", time_offset)
    Camera.load(path)
    text = Path(path).read_text(encoding="utf-8")
    line = f"time_offset = {time_offset!r}"
    changed, found = re.subn(r"^[ \t]*time_offset[ \t]*=[^#\n]*", line, text, count=1, flags=re.MULTILINE)
    if not found:
        changed = f"{text.rstrip()}\n{line}\n"
    with atomic_write(path) as file:
        file.write(changed.encode())
