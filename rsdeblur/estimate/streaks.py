"""Light streaks: trails of small bright things, which show the PSF in the blurred picture.

A lamp, or the glint of a screw, is a point in the sharp picture, so its trail in the blurred one has the shape of the
PSF there, with its phase, which spectra lack. Hu, Cho, Wang and Yang, "Deblurring low-light images with light streaks",
CVPR 2014, find such trails in photos by night and estimate the PSF from them. Here they only compare motions. A trail
that no motion explains, as of a line of the scene, is ignored.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import LONGEST_BLUR, SOFTNESS, UNDESCRIBED
from rsdeblur.estimate.sharpness import TILES
from rsdeblur.image.encoded import upright
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.tuning.noise import noise_level
from rsdeblur.types import ComplexArray, FloatArray, FloatImage

# Thickest trail, px; PSFs whose diagonal is no longer have no shape.
THICKEST = 7
# A trail is brighter than what it lies on by this many times the noise, and times the level that this share of the
# values within some diagonals of PSFs does not exceed, and by this share of the light there.
CLEAR, AROUND, UNUSUAL, LEAST_CONTRAST = 5.0, 1.5, 0.9, 0.1
# It ends at this share of its peak, or at so many times that level.
END, ABOVE = 0.25, 2.0
# Bounds of its diagonal, as shares of that of the PSFs as recorded, and a margin, px. Longer things are lines of the
# scene.
LENGTHS, MARGIN = (0.5, 1.6), 4.0
# Sizes of the bright thing, including the softness of the photo: standard deviations of a Gaussian, px.
SIZES = 0.7, 1.5
# Least share of the PSF's power that is not hidden.
LEAST_SEEN = 0.8
# Nats that a loss of the squared correlation costs: as of four independent values, to which noise, processing and the
# shape of the thing add errors of 5 % of the power. A correlation below 0.7 is no agreement, so a trail proves at most
# as much as a perfect one does over that.
NATS_PER_LOSS, MOST_NATS = 40.0, 20.4
# Nats that all trails together prove at most, as five perfect ones: several may belong to one thing.
MOST_TOGETHER = 5 * MOST_NATS

Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Streak:
    """A trail with its centre in the upright picture, px, and what surrounds it, shape (N, N)."""

    row: int
    col: int
    values: NDArray[np.float32]  # light of thin things, 0 where others than the trail are
    seen: NDArray[np.float32]  # 0 where others are, and beyond the picture; 1 elsewhere


class LightStreaks:
    """How well the trails of small bright things agree with motions.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced; `recording` is the one given. There
    are no `streaks` if the PSFs are too small to have a shape.
    """

    def __init__(self, light: FloatImage, recording: Recording) -> None:
        camera, length = recording.camera, max(recording.capture().mean_length, 1.0)
        self._scale = min(1.0, max(light.shape) / max(camera.width, camera.height), LONGEST_BLUR / length)
        light = upright(light, camera, self._scale)
        self._rows, self._cols = (tile_centres(count, side) for count, side in zip(TILES, light.shape, strict=True))
        extent = np.ptp(self._paths(recording).displacements, axis=2).max(axis=(0, 1))
        diagonal = float(np.hypot(*extent))
        self.streaks = find_streaks(light, diagonal) if diagonal > THICKEST else []
        # A trail may show a part of the PSF, which may be any.
        self._reach = int((1 - LENGTHS[0]) * diagonal + MARGIN)
        self._centre = _half(diagonal)
        self._side = fft.next_fast_len(2 * self._centre + 1 + self._reach, real=True)
        self._places = [
            (int(np.abs(self._rows - each.row).argmin()), int(np.abs(self._cols - each.col).argmin()))
            for each in self.streaks
        ]
        if self.streaks:
            values, seen = (np.stack([getattr(each, name) for each in self.streaks]) for name in ("values", "seen"))
            self._power = np.square(values).sum(axis=(1, 2))[:, None, None, None]
            self._values, self._seen = (self._spectra(each[:, None]) for each in (values, seen))

    def _paths(self, recording: Recording) -> BlurPaths:
        return BlurPaths.from_capture(recording.capture(self._scale), self._rows, self._cols)

    def _spectra(self, pictures: FloatImage) -> ComplexArray:
        spectra: ComplexArray = fft.rfft2(pictures, (self._side, self._side))
        return spectra

    def nats(self, recording: Recording) -> float:
        """Return how much likelier the trails are under a motion than under none that explains them, nats."""
        if not self.streaks:
            return 0.0
        try:
            kernels = PsfBank.from_paths(self._paths(recording), threads=1).kernels
        except UNDESCRIBED:
            return 0.0
        trails = np.stack([_trails(kernels[place], self._side, self._centre) for place in self._places])
        least = LEAST_SEEN * np.square(trails).sum(axis=(2, 3), keepdims=True)
        drawn, squares = (self._spectra(each).conj() for each in (trails, np.square(trails)))
        power = self._near(self._seen * squares)
        rho = self._near(self._values * drawn) / np.sqrt(np.where(power <= least, np.inf, self._power * power))
        # The largest correlation of each trail with the PSF there, over shifts and sizes of the thing.
        lost = 1 - np.square([max(map(_peak, each)) for each in rho])
        # The logarithm of a sum: a trail of the motion, or one of anything.
        return float((MOST_NATS + np.logaddexp(-NATS_PER_LOSS * lost, -MOST_NATS)).sum())

    def _near(self, product: ComplexArray) -> FloatImage:
        """Return the correlations at all shifts that are near enough."""
        near = np.r_[-self._reach : self._reach + 1]
        columns = fft.ifft(product, axis=-2)[..., near, :]
        correlations: FloatImage = fft.irfft(columns, self._side, axis=-1)[..., near]
        return correlations


def lead_of(nats: float, others: float) -> float:
    """Return how much likelier trails with `nats` make a motion than another one with `others`, nats; it is bounded."""
    return float(MOST_TOGETHER * np.tanh((nats - others) / MOST_TOGETHER))


def find_streaks(light: FloatImage, diagonal: float) -> list[Streak]:
    """Return the 16 clearest trails in linear light (H, W); the box around the PSFs has this `diagonal`, px."""
    thin, half = thin_things(light), _half(diagonal)
    level = np.maximum(_usual(thin, max(1, round(AROUND * diagonal))), noise_level(light[..., None]))
    clear = np.maximum(CLEAR * level, LEAST_CONTRAST * light)
    tops = np.argwhere((thin == ndimage.maximum_filter(thin, THICKEST)) & (thin > clear))
    brightest = np.argsort(-thin[tuple(tops.T)], kind="stable")
    floor = np.pad(ABOVE * level, half, mode="edge")
    inside, thin = np.pad(np.ones(thin.shape, dtype=bool), half), np.pad(thin, half)
    taken, found = np.zeros(thin.shape, dtype=bool), []
    for row, col in (tops[brightest] + half).tolist():
        if taken[row, col]:
            continue
        rows, cols = _connected(thin, floor, row, col, half)
        is_new = not taken[rows, cols].any()
        taken[rows, cols] = True
        if is_new and _fits(rows - row, cols - col, diagonal):
            found.append((-thin[row, col] / floor[row, col], rows, cols))
    found.sort(key=lambda each: float(each[0]))
    return [_cut(thin, floor, inside, rows, cols, half) for _, rows, cols in found[:16]]


def thin_things(light: FloatImage, smoothing: float = SOFTNESS) -> FloatImage:
    """Return the light of things thinner than `THICKEST` px, smoothed first, without that of what they lie on."""
    smooth = ndimage.gaussian_filter(light, smoothing, mode="nearest")
    thin: FloatImage = smooth - ndimage.grey_opening(smooth, size=(THICKEST, THICKEST), mode="nearest")
    return thin


def _half(diagonal: float) -> int:
    """Return how far around a trail the picture is compared, px."""
    return int(diagonal + MARGIN) + THICKEST


def _usual(thin: FloatImage, side: int) -> FloatArray:
    """Return the level that most values around each pixel do not exceed."""
    places = [(np.arange(n) * max(1, n // side)) // n for n in thin.shape]
    counts = [int(each[-1]) + 1 for each in places]
    levels = np.empty(counts)
    for row in range(counts[0]):
        band = thin[places[0] == row]
        for col in range(counts[1]):
            levels[row, col] = np.quantile(band[:, places[1] == col], UNUSUAL)
    around: FloatArray = ndimage.uniform_filter(levels, 3, mode="nearest")[np.ix_(*places)]
    return around


def _connected(thin: FloatImage, floor: FloatArray, row: int, col: int, half: int) -> tuple[Places, Places]:
    """Return the rows and columns of the pixels that belong to the trail with a peak."""
    box = np.s_[row - half : row + half + 1, col - half : col + half + 1]
    labels, _ = ndimage.label(thin[box] > np.maximum(floor[box], END * thin[row, col]), np.ones((3, 3)))
    rows, cols = np.nonzero(labels == labels[half, half])
    return rows + row - half, cols + col - half


def _fits(rows: Places, cols: Places, diagonal: float) -> bool:
    """Return whether pixels, relative to their peak, may be the trail of a point."""
    length = float(np.hypot(np.ptp(rows) + 1, np.ptp(cols) + 1))
    is_whole = max(np.abs(rows).max(), np.abs(cols).max()) < _half(diagonal)
    is_thin = len(rows) <= THICKEST * length
    return bool(is_whole and is_thin and LENGTHS[0] * diagonal <= length <= LENGTHS[1] * diagonal + MARGIN)


def _cut(
    thin: FloatImage, floor: FloatArray, inside: NDArray[np.bool_], rows: Places, cols: Places, half: int
) -> Streak:
    """Return a trail with what surrounds it, out of the picture with a border of `half` px."""
    row, col = (int(each.min() + each.max()) // 2 for each in (rows, cols))
    own = np.zeros((2 * half + 1, 2 * half + 1), dtype=bool)
    own[rows - row + half, cols - col + half] = True
    box = np.s_[row - half : row + half + 1, col - half : col + half + 1]
    values, least, seen = thin[box], floor[box], inside[box]
    bright = values > np.maximum(least, END * values[own].max())
    # Within 2 px of the trail, nothing is hidden.
    others, near = (ndimage.binary_dilation(each, iterations=2) for each in (bright & ~own, own))
    seen = seen & (near | ~others)
    return Streak(row - half, col - half, (values * seen).astype(np.float32), seen.astype(np.float32))


def _trails(kernel: NDArray[np.float32], side: int, centre: int) -> NDArray[np.float32]:
    """Return the trails of things of several sizes around a pixel of a square; zeros if it does not hold them."""
    rows, cols = np.nonzero(kernel > 0)
    cut = np.pad(kernel[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1], THICKEST)
    trails = np.zeros((len(SIZES), side, side), dtype=np.float32)
    if max(cut.shape) > side:
        return trails
    for trail, size in zip(trails, SIZES, strict=True):
        trail[: cut.shape[0], : cut.shape[1]] = thin_things(cut, float(np.hypot(size, SOFTNESS)))
    return np.roll(trails, [centre - n // 2 for n in cut.shape], axis=(1, 2))


def _peak(surface: FloatImage) -> float:
    """Return the height of the highest peak, between samples."""
    row, col = np.unravel_index(int(surface.argmax()), surface.shape)
    top = height = float(surface[row, col])
    for line, at in ((surface[:, col], int(row)), (surface[row], int(col))):
        if 0 < at < len(line) - 1:
            below, above = float(line[at - 1]), float(line[at + 1])
            bend = 2 * top - below - above
            height += (above - below) ** 2 / (8 * bend) if bend > 0 else 0.0
    return min(height, 1.0)
