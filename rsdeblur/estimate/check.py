"""Check of a result without a reference: whether the motion explains the blurred picture, and whether the result rings.

To blur the result again proves little: a wrong PSF that was divided out gives the input again. Two other tests do prove
something. The first uses the spectra of the blurred picture, as :mod:`rsdeblur.estimate.time_offset` does. Under the
right motion they are likelier than under alternatives: other sizes of the motion, its mirror image, its axes exchanged,
straight blurs and no blur. Half a turn leaves them as they are; there the sharp picture decides. The second is light
below black: a wrong inverse leaves waves, which in dark places fall below zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import share, share_map
from rsdeblur.choices import Verdict
from rsdeblur.estimate.noise import noise_level
from rsdeblur.estimate.periodograms import TILE
from rsdeblur.estimate.quick_sharpness import QuickSharpness
from rsdeblur.estimate.sharpness import SIDE
from rsdeblur.estimate.spectra import TilePeriodograms
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# Bounds of "doubtful" and "bad": lead of the motion over the best alternative, nats per tile, and light below black as
# a share of the picture's contrast. docs/developer/reliability.md says how they were chosen and how often they are
# right.
DOUBTFUL_LEAD, BAD_LEAD = -1.5, -6.0
DOUBTFUL_RINGING, BAD_RINGING = 0.045, 0.15
# Fall of the logarithm of l1 / l2 of the gradient under the motion turned by half a turn.
DOUBTFUL_TURN, BAD_TURN = 0.01, 0.03
# Residual from which hardly anything of the picture is left in the result; 1 is that of an even result.
LOST = 0.9
# Lead over every alternative, nats per tile, from which twice the ringing is allowed: such motion is right, and hard
# edges on black ring in any case.
CLEAR_LEAD = 2.0

# Largest lead that a tile counts for, nats. The edge of a door, say, looks like a straight blur beyond doubt.
MOST_NATS = 10.0
# The picture is reduced at least so often, because cameras denoise and sharpen the finest detail, and until the blur is
# at most so long, px.
LEAST_REDUCTION, REDUCED_BLUR = 2.0, 16.0
# Most tiles along each axis of the picture.
MOST_TILES = 6
# Least standard deviation of the tiles over that of their noise; with less there is no detail to compare.
LEAST_DETAIL = 2.0
# Side of a tile with the pixel before it, which its first differences need, px.
CELL = TILE + 1
# Mean length of the paths, px, below which a blur cannot be distinguished from the softness of a lens.
SHORT = 3.0
# Alternatives: the motion's size, and lengths (px) and directions of straight blurs.
SIZES = (0.5, 0.7, 1.4, 2.0)
LINES, DIRECTIONS = (3.0, 7.0, 15.0), 4
# Candidates for the power of the scene, as multiples of its mean, which strong edges dominate. For that of the noise
# there is only its estimate: if less noise were possible, short blurs would explain noise as detail.
LEVELS = np.ones(1)
# Distance of the rows that are measured for light below black, in pictures of at least 64 such rows.
ROW_STEP = 8

# Alternatives that do not make a result bad. If the motion is too small, too little blur is removed, which does little
# harm. And the edges of man-made things look like a straight blur.
HARMLESS = (*(f"{size:g} times" for size in SIZES if size > 1), "straight")

HINTS = {
    "still": "no blur at all.",
    "mirrored": "the motion mirrored: is one of the gyroscope's axes reversed?",
    "exchanged": "the motion with x and y exchanged: are the gyroscope's axes right?",
    "straight": "a straight blur: is it another moment's motion, or does the scene move?",
} | {
    f"{size:g} times": f"{size:g} times the motion: are the focal length and the unit of the rates right?"
    for size in SIZES
}


@one_line()
@dataclass(frozen=True, slots=True)
class QualityCheck:
    """Check of a result of :func:`rsdeblur.deblur`.

    Parameters
    ----------
    verdict : {"good", "cannot tell", "doubtful", "bad"}
        Whether to trust the result; "cannot tell" if it does not ring and nothing else can be judged.
    reasons : tuple of str
        Sentences that explain the verdict, or name what could not be judged.
    lead : float or None
        Log-likelihood of the blurred picture under the motion minus that under the best alternative, in nats per tile,
        where no tile counts for more than 10; negative if the alternative wins, None if it cannot be judged.
    alternative : str or None
        The best alternative; where one makes the result bad, the best of those that can.
    weakest : float or None
        Lead in the two neighbouring rows of tiles where it is least. It shows where to look and does not enter the
        verdict: parts of a scene may look like an alternative.
    ringing : float
        Light below black that deblurring added, root mean square, as a share of the picture's standard deviation.
    noise_gain : float or None
        Noise of the result over that of the input.
    residual : float or None
        Difference between the input and the result blurred again, root mean square, as a share of the picture's
        standard deviation; None if the PSF is too large for a tile or the result was straightened.
    half_turn : float or None
        By how much the logarithm of l1 / l2 of the gradient falls if the motion is turned by half a turn about the
        optical axis; positive if the picture becomes sharper so, 0 if it has less than 160 px on its shorter side,
        None if the motion cannot be judged.
    leads, ringings : tuple of float
        Lead and ringing in equal parts of the picture along the readout. A part's lead is over the alternative that is
        best there, of those that can make a result bad.
    blended : bool
        Whether the result was blended towards the input because of this check.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    lead: float | None
    alternative: str | None
    weakest: float | None
    ringing: float
    noise_gain: float | None
    residual: float | None
    half_turn: float | None
    leads: tuple[float, ...]
    ringings: tuple[float, ...]
    blended: bool = False


class UndershootMeter:
    """Measurement, chunk by chunk, of the light below black that deblurring adds.

    Parameters
    ----------
    height : int
        Rows of the picture.
    """

    def __init__(self, height: int) -> None:
        self._step = int(np.clip(height // 64, 1, ROW_STEP))
        # Not row 0, because the first row of the frame rings more than others.
        self._first = self._step // 2
        self._part = np.arange(self._first, height, self._step) * MOST_TILES // height
        self._rows = np.zeros((4, len(self._part)))

    def before(self, light: NDArray[np.float32], rows: slice) -> None:
        """Measure rows of the input."""
        light, at = self._some(light, rows)
        self._rows[:3, at] = light.mean((1, 2)), np.square(light).mean((1, 2)), _below_black(light)

    def after(self, light: NDArray[np.float32], rows: slice) -> None:
        """Measure rows of the result, before they are clipped."""
        light, at = self._some(light, rows)
        self._rows[3, at] = _below_black(light)

    def _some(self, light: NDArray[np.float32], rows: slice) -> tuple[NDArray[np.float32], slice]:
        first, stop = (-(-(row - self._first) // self._step) for row in (rows.start, rows.stop))
        return light[first * self._step + self._first - rows.start :: self._step], slice(first, stop)

    def ringing(self) -> tuple[float, tuple[float, ...]]:
        """Return the ringing of the whole picture and of each part."""
        mean, square, before, after = self._rows
        contrast = max(float(square.mean() - mean.mean() ** 2), 1e-12)
        gained = (after - before) / contrast
        parts = [gained[self._part == part] for part in range(MOST_TILES)]
        whole, *each = (np.sqrt(max(float(np.mean(part)), 0.0)) if part.size else 0.0 for part in (gained, *parts))
        return float(whole), tuple(map(float, each))


def _below_black(light: NDArray[np.float32]) -> FloatArray:
    below = np.minimum(light, 0.0)
    np.square(below, out=below)
    means: FloatArray = below.mean((1, 2)).astype(np.float64)
    return means


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
    encoded, result : EncodedImage
        The blurred picture and the sharp one, readout along y.
    capture : Capture
        The motion that was undone.
    meter : UndershootMeter
        Measurements of both pictures.
    resampled : bool
        Whether the result was straightened.
    threads : int, optional
        Threads that share the work; default all processors.

    Returns
    -------
    QualityCheck
    """
    ringing, ringings = meter.ringing()
    check = QualityCheck("cannot tell", (), None, None, None, ringing, None, None, None, (), ringings)
    length = capture.mean_length
    height, width, _ = encoded.shape
    if length < SHORT:
        return _with_verdict(check, f"The motion explains {length:.1f} px of blur, too little to be judged.")
    if min(height, width) < CELL:
        return _with_verdict(check, f"The picture is narrower than {CELL} px, too small to judge the motion by.")
    step = int(max(1.0, min(max(length / REDUCED_BLUR, LEAST_REDUCTION), min(height, width) // (2 * CELL))))
    tiles, moving = _Tiles(encoded, capture, step, threads), _Moving(capture)
    if not tiles.detailed:
        return _with_verdict(check, "The picture shows no detail to judge the motion by.")
    # Each is too small to be shared, but they need not wait for each other.
    measures: tuple[Callable[[], Any], ...] = (
        lambda: QuickSharpness(_reduced(encoded), moving),
        tiles.alternatives,
        lambda: tiles.compare(result, resampled=resampled),
    )
    quick, scores, (gain, residual) = share_map(lambda measure: measure(), measures, threads)
    means = {name: float(score.mean()) for name, score in scores.items()}
    harmful = {name: mean for name, mean in means.items() if name not in HARMLESS}
    alternative = min(harmful if min(harmful.values()) < BAD_LEAD else means, key=means.__getitem__)
    check = replace(
        check,
        lead=means[alternative],
        alternative=alternative,
        weakest=min(float(_neighbouring(score).min()) for score in scores.values()),
        noise_gain=gain,
        residual=residual,
        half_turn=quick.half_turn(moving, threads=threads),
        leads=tuple(map(float, np.min([scores[name] for name in harmful], axis=0))),
    )
    return _with_verdict(check)


def _with_verdict(check: QualityCheck, *reasons: str) -> QualityCheck:
    """Return `check` with the verdict and the reasons that follow from its figures."""
    lead = np.inf if check.lead is None else check.lead
    turn = -np.inf if check.half_turn is None else check.half_turn
    clear = CLEAR_LEAD < lead < np.inf and turn <= DOUBTFUL_TURN
    ringing = check.ringing / (2.0 if clear else 1.0)
    # Ringing is NaN in a result that is not finite.
    bad = (lead < BAD_LEAD and check.alternative not in HARMLESS) or not ringing <= BAD_RINGING or turn > BAD_TURN
    unfit = f"The motion {'does' if bad else 'may'} not fit."
    sentences = list(reasons)
    if lead < DOUBTFUL_LEAD and check.alternative is not None:
        sentences.append(f"{unfit} The picture is explained better by {HINTS[check.alternative]}")
    if turn > DOUBTFUL_TURN:
        sentences.append(
            f"{unfit} The picture becomes sharper with the motion turned by half a turn: is it upside down, or are two "
            "of the gyroscope's axes reversed?"
        )
    if ringing > DOUBTFUL_RINGING:
        sentences.append(f"The result rings: light below black is {check.ringing:.1%} of the picture's contrast.")
    if check.residual is not None and check.residual > LOST:
        sentences.append("The result has lost the picture's detail: are nsr and weight too large?")
    doubtful, unknown = len(sentences) > len(reasons), check.lead is None
    verdict: Verdict = "bad" if bad else "doubtful" if doubtful else "cannot tell" if unknown else "good"
    return replace(check, verdict=verdict, reasons=tuple(sentences))


def _neighbouring(score: FloatArray) -> FloatArray:
    """Return the means of neighbouring rows of tiles."""
    return (score[1:] + score[:-1]) / 2 if len(score) > 1 else score


class _Tiles:
    """Some tiles of a picture, reduced by a whole factor and in grey, with the PSFs there."""

    def __init__(self, encoded: EncodedImage, capture: Capture, step: int, threads: int | None) -> None:
        self._step = step
        self._corners = [_spread(n // step) for n in encoded.shape[:2]]
        self._blurred, finest = self._cells(encoded, threads)
        self._noise = noise_level(_mosaic(finest)[..., None])
        rows, cols = (corners + (CELL + 1) / 2 for corners in self._corners)
        self._paths = BlurPaths.from_capture(_Moving(capture).capture(1 / step), rows, cols)
        # So few PSFs are drawn sooner than threads start.
        self._kernels = PsfBank.from_paths(self._paths, threads=1).kernels

    @property
    def detailed(self) -> bool:
        """Whether the tiles show more than noise; the reduction has made the noise weaker."""
        return float(self._blurred.std()) > max(LEAST_DETAIL * self._noise / self._step, 1e-6)

    def _cells(self, encoded: EncodedImage, threads: int | None = 1) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the tiles reduced, and corners of them of the same size unreduced, both (B, S, CELL, CELL)."""
        tops, lefts = (corners * self._step for corners in self._corners)
        reduced, finest = np.empty((2, len(tops), len(lefts), CELL, CELL), dtype=np.float32)
        channels, side = encoded.shape[2], CELL * self._step

        def reduce(_: int, b: int) -> None:
            for s, left in enumerate(lefts):
                values = encoded.values[tops[b] : tops[b] + side, left : left + side, :channels]
                cell = EncodedImage(values, encoded.transfer).grey(slice(None))
                finest[b, s] = cell[:CELL, :CELL]
                reduced[b, s] = cell.reshape(CELL, self._step, CELL, self._step).mean(axis=(1, 3))

        share(reduce, range(len(tops)), threads)
        return reduced, finest

    def alternatives(self) -> dict[str, FloatArray]:
        """Return the lead of the motion over each alternative, nats, as means of the rows of tiles, shape (B,)."""
        places = [np.arange(len(corners)) * CELL + 1 for corners in self._corners]
        measured = TilePeriodograms(_mosaic(self._blurred), *places)
        shape = tuple(map(len, places))

        def fit(kernels: NDArray[np.float32]) -> FloatArray:
            expected = measured.expected(kernels)
            place = np.broadcast_to(np.arange(len(expected)).reshape(kernels.shape[:2]), shape).ravel()
            return measured.fit(expected, place, levels=LEVELS)[0].reshape(shape)

        of_motion = fit(self._kernels)

        def lead(kernels: NDArray[np.float32]) -> FloatArray:
            each_row: FloatArray = (fit(kernels) - of_motion).clip(-MOST_NATS, MOST_NATS).mean(axis=1)
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
            "straight": best(_lines()),
            **{f"{size:g} times": lead(PsfBank.from_paths(paths, threads=1).kernels) for size, paths in sized.items()},
        }

    def compare(self, result: EncodedImage, *, resampled: bool) -> tuple[float | None, float | None]:
        """Return the noise gain and the residual of the result, see :class:`QualityCheck`."""
        sharp, finest = self._cells(result)
        gain = noise_level(_mosaic(finest)[..., None]) / self._noise if self._noise > 0 else None
        return gain, None if resampled else self._residual(sharp)

    def _residual(self, sharp: NDArray[np.float32]) -> float | None:
        """Return the residual in the inner parts of the tiles, whose blur needs no pixels outside."""
        tall, wide = self._kernels.shape[2:]
        if max(tall, wide) > TILE // 2:
            return None
        spectra = rfft2(sharp, (TILE, TILE)) * rfft2(self._kernels, (TILE, TILE))
        # The part of the periodic convolution that does not wrap around.
        again = irfft2(spectra, (TILE, TILE))[..., tall - 1 :, wide - 1 :]
        inner = np.s_[..., tall // 2 : TILE - tall // 2, wide // 2 : TILE - wide // 2]
        difference = float(np.sqrt(np.mean(np.square(again - self._blurred[inner]))))
        return difference / float(self._blurred.std())


@dataclass(frozen=True, slots=True)
class _Moving:
    """The known motion of an upright picture, see :class:`rsdeblur.estimate.quick_sharpness.Moving`."""

    whole: Capture

    @property
    def camera(self) -> Camera:
        return self.whole.camera

    def capture(self, scale: float = 1.0) -> Capture:
        if scale == 1.0 and self.whole.softness == 0.0:
            # It may have its probe already.
            return self.whole
        # In the reduced picture, a softness of up to 1 px hardly counts.
        return replace(self.whole, camera=self.whole.camera.scaled(scale), softness=0.0)


def _reduced(encoded: EncodedImage) -> NDArray[np.float32]:
    """Return the picture in grey, reduced to :data:`rsdeblur.estimate.sharpness.SIDE` px or a little more."""
    height, width, channels = encoded.shape
    step = max(max(height, width) // SIDE, 1)
    # Four pixels of each cell are enough: the blur has removed fine detail.
    within = sorted({step // 4, 3 * step // 4})
    cells = [
        encoded.values[top::step, left::step, :channels][: height // step, : width // step]
        for top in within
        for left in within
    ]
    greys = [EncodedImage(cell, encoded.transfer).grey(slice(None)) for cell in cells]
    mean: NDArray[np.float32] = np.mean(greys, axis=0)
    return mean


def _spread(length: int) -> NDArray[np.intp]:
    """Return the first pixels of cells that are spread over `length` px and overlap by half at most."""
    count = min(MOST_TILES, 2 * length // CELL - 1)
    return np.round(np.linspace(0, length - CELL, count)).astype(np.intp)


def _mosaic(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    down, across = cells.shape[:2]
    return cells.swapaxes(1, 2).reshape(down * CELL, across * CELL)


def _lines() -> list[NDArray[np.float32]]:
    """Return straight blurs as kernels of shape (1, 1, k, k)."""
    along = np.linspace(-0.5, 0.5, 129)[:, None]
    half = int(max(LINES) // 2) + 1
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    paths = [length * along * (np.cos(angle), np.sin(angle)) for length in LINES for angle in angles]
    return [kernel[None, None] for kernel in rasterize(np.stack(paths), half, half, 1)]


def fall_back(encoded: EncodedImage, check: QualityCheck, out: NDArray[Any]) -> QualityCheck:
    """Blend `out`, which is upright like the picture, towards the input where its figures are bad, in linear light."""
    height = encoded.shape[0]
    share = np.maximum(
        _share(check.ringings, height, DOUBTFUL_RINGING, BAD_RINGING),
        _share(check.leads, height, DOUBTFUL_LEAD, BAD_LEAD),
    )
    if check.half_turn is not None:
        share = np.maximum(share, _share((check.half_turn,), height, DOUBTFUL_TURN, BAD_TURN))
    sharp = EncodedImage(out, encoded.transfer)
    for top in range(0, height, CELL):
        rows = slice(top, min(top + CELL, height))
        if share[rows].any():
            weight = share[rows, None, None].astype(np.float32)
            encoded.encode(weight * encoded.linear(rows) + (1 - weight) * sharp.linear(rows), rows, out)
    return replace(check, blended=True)


def _share(figures: tuple[float, ...], height: int, doubtful: float, bad: float) -> FloatArray:
    """Return the share of the input in every row, from the figures of equal parts: 0 at `doubtful`, 1 at `bad`."""
    if not figures:
        return np.zeros(height)
    shares = ((np.array(figures) - doubtful) / (bad - doubtful)).clip(0.0, 1.0)
    centres = (np.arange(len(figures)) + 0.5) * height / len(figures) - 0.5
    each_row: FloatArray = np.interp(np.arange(height), centres, shares)
    return each_row
