"""What a blurred picture alone says of its motion, whatever is done with it.

Its spectra are likelier under the right motion than under alternatives: other sizes of the motion, its mirror image,
its axes exchanged, straight blurs and no blur. Half a turn of the motion leaves the spectra as they are; there the
sharp picture that it leads to decides. :mod:`rsdeblur.estimate.check` draws the conclusions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share, share_map
from rsdeblur.estimate.cepstrum import spread
from rsdeblur.estimate.sharpness import SIDE, QuickSharpness, captured
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.kernels.raster import rasterize
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.noise import DIRECTIONS, TILE, TilePeriodograms, noise_level
from rsdeblur.types import FloatArray

# Largest lead that a tile counts for, nats. The edge of a door, say, looks like a straight blur beyond doubt.
MOST_NATS = 10.0
# The picture is reduced at least so often, because cameras denoise and sharpen the finest detail, and until the blur is
# at most so long, px.
LEAST_REDUCTION, REDUCED_BLUR = 2.0, 16.0
# Least standard deviation of the tiles over that of their noise; with less there is no detail to compare.
LEAST_DETAIL = 2.0
# Side of a tile with the pixel before it, which its first differences need, px.
CELL = TILE + 1
# Mean length of the paths, px, below which a blur cannot be distinguished from the softness of a lens.
SHORT = 3.0
# Shorter side, px, from which pictures tell a motion from half a turn of it. With right motions, `half_turn` reached
# 0.03 in pictures of 66 to 100 px, and 0.008 in larger ones.
LEAST_TURNED = 160
# Alternatives: the motion's size, and lengths of straight blurs, px, in every other direction of the spectra.
SIZES = (0.5, 0.7, 1.4, 2.0)
LINES = 3.0, 7.0, 15.0


@dataclass(frozen=True, slots=True, eq=False)
class MotionEvidence:
    """What a blurred picture says of its motion."""

    tiles: CheckTiles | None = None  # None where they say nothing
    unknown: str = ""  # sentence that says why
    leads: dict[str, float] = field(default_factory=dict)  # over each alternative, nats per tile
    half_turn: float | None = None  # that of :class:`rsdeblur.estimate.QualityCheck`
    # Takes names of straight blurs and other sizes, and a number of threads, and returns how much clearer the sharp
    # picture is with the motion than with each: differences of the logarithm of l1 / l2 of the gradient.
    clearer: Callable[[Sequence[str], int | None], list[float]] = field(default=lambda names, _: [0.0] * len(names))
    frames: int = 1

    @classmethod
    def of(cls, encoded: EncodedImage, capture: Capture, *, threads: int | None = None) -> MotionEvidence:
        """Measure a blurred picture that has its readout along y, under its motion."""
        length = capture.mean_length
        height, width, _ = encoded.shape
        if length < SHORT:
            return cls(unknown=f"The motion explains {length:.1f} px of blur, too little to be judged.")
        if min(height, width) < CELL:
            return cls(unknown=f"The picture is narrower than {CELL} px, too small to judge the motion by.")
        step = int(max(1.0, min(max(length / REDUCED_BLUR, LEAST_REDUCTION), min(height, width) // (2 * CELL))))
        tiles = CheckTiles(encoded, capture, step, threads)
        if not tiles.detailed:
            return cls(unknown="The picture shows no detail to judge the motion by.")

        def turned() -> tuple[QuickSharpness, float, float]:
            sharpness = QuickSharpness(_reduced(encoded), capture)
            # Backwards, the motion is turned by half a turn, with which the spectra are the same.
            own, turned = sharpness.under(capture, (1.0, -1.0), threads=1)
            return sharpness, own, own - turned if min(height, width) >= LEAST_TURNED else 0.0

        # Each is too small to be shared, but they need not wait for each other.
        measures: tuple[Callable[[], Any], ...] = turned, tiles.alternatives
        (sharpness, own, turn), (leads, line) = share_map(lambda measure: measure(), measures, threads)
        others = {"straight": line} | {f"{size:g} times": size for size in SIZES}

        def clearer(names: Sequence[str], threads: int | None) -> list[float]:
            measures = sharpness.under(capture, [others[name] for name in names], threads=threads)
            return [each - own for each in measures]

        return cls(tiles, "", leads, turn, clearer)

    @classmethod
    def of_burst(cls, frames: Sequence[tuple[EncodedImage, Capture]], *, threads: int | None = None) -> MotionEvidence:
        """Measure the frames of a result, the reference first; means of those that say something of their motions."""
        each = [cls.of(encoded, capture, threads=threads) for encoded, capture in frames]
        judged = [evidence for evidence in each if evidence.tiles is not None]
        if each[0].tiles is None or len(judged) == 1:
            return each[0]
        return cls(
            each[0].tiles,
            "",
            {name: float(np.mean([evidence.leads[name] for evidence in judged])) for name in each[0].leads},
            float(np.mean([evidence.half_turn for evidence in judged])),
            lambda names, threads: np.mean([evidence.clearer(names, threads) for evidence in judged], axis=0).tolist(),
            len(judged),
        )


class CheckTiles:
    """Some tiles of a picture, reduced by a whole factor and in grey, with the PSFs there."""

    def __init__(self, encoded: EncodedImage, capture: Capture, step: int, threads: int | None) -> None:
        self.encoded, self.capture, self._step = encoded, capture, step
        self._corners = [spread(n // step, CELL, 6) for n in encoded.shape[:2]]
        self._blurred, finest = self._cells(encoded, threads)
        self.noise = noise_level(_mosaic(finest)[..., None])
        rows, cols = (corners + (CELL + 1) / 2 for corners in self._corners)
        self._paths = BlurPaths.from_capture(captured(capture, 1 / step), rows, cols)
        # So few PSFs are drawn sooner than threads start.
        self._kernels = PsfBank.from_paths(self._paths, threads=1).kernels

    @property
    def detailed(self) -> bool:
        """Whether the tiles show more than noise; the reduction has made the noise weaker."""
        return float(self._blurred.std()) > max(LEAST_DETAIL * self.noise / self._step, 1e-6)

    def _cells(self, encoded: EncodedImage, threads: int | None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
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

    def alternatives(self) -> tuple[dict[str, float], FloatArray]:
        """Return the lead of the motion over each alternative, nats per tile, and the best straight path (T, 2), px."""
        places = [np.arange(len(corners)) * CELL + 1 for corners in self._corners]
        measured = TilePeriodograms(_mosaic(self._blurred), *places)
        shape = tuple(map(len, places))

        def fit(kernels: NDArray[np.float32]) -> FloatArray:
            expected = measured.expected(kernels)
            place = np.broadcast_to(np.arange(len(expected)).reshape(kernels.shape[:2]), shape).ravel()
            return measured.fit(expected, place)[0].reshape(shape)

        of_motion = fit(self._kernels)

        def lead(kernels: NDArray[np.float32]) -> float:
            return float((fit(kernels) - of_motion).clip(-MOST_NATS, MOST_NATS).mean())

        turned = np.swapaxes(self._kernels, 2, 3)
        still = np.ones((1, 1, 1, 1), dtype=np.float32)
        sized = {size: replace(self._paths, displacements=size * self._paths.displacements) for size in SIZES}
        lines, half = _lines(), int(max(LINES) // 2) + 1
        straight = [lead(kernel[None, None]) for kernel in rasterize(lines, half, half, 1)]
        leads = {
            "mirrored": lead(self._kernels[:, :, ::-1]),
            "exchanged": min(lead(turned), lead(turned[:, :, ::-1])),
            "still": lead(still),
            "straight": min(straight),
            **{f"{size:g} times": lead(PsfBank.from_paths(paths, threads=1).kernels) for size, paths in sized.items()},
        }
        return leads, self._step * lines[int(np.argmin(straight))]

    def detail(self, result: EncodedImage, *, threads: int | None) -> float | None:
        """Return the detail of the result, see :class:`rsdeblur.estimate.QualityCheck`."""
        sharp, _ = self._cells(result, threads)
        # White noise has the same variance in all pixels, and twice that in each difference.
        left = _gradient(self._blurred) - 4 * (self.noise / self._step) ** 2
        return _gradient(sharp) / left if left > 0 else None


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


def _mosaic(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    down, across = cells.shape[:2]
    return cells.swapaxes(1, 2).reshape(down * CELL, across * CELL)


def _gradient(cells: NDArray[np.float32]) -> float:
    """Return the mean energy of the gradient in tiles (B, S, h, w)."""
    return sum(float(np.square(np.diff(cells, axis=axis)).mean()) for axis in (2, 3))


def _lines() -> FloatArray:
    """Return straight blurs as paths, shape (N, T, 2)."""
    along = np.linspace(-0.5, 0.5, 129)[:, None]
    angles = np.pi * np.arange(0, DIRECTIONS, 2) / DIRECTIONS
    return np.stack([length * along * (np.cos(angle), np.sin(angle)) for length in LINES for angle in angles])
