"""Waves and grain that a result has where its motion leaves no signal.

At the frequencies that a PSF removes, a right result has little: the blurred picture does not ask for more, since the
result, blurred again, would not show it. Waves beside edges (a wrong motion) and crinkled walls (a weight that is too
small) are strongest just there. The cepstrum, the transform of the logarithm of the power, separates both from the
scene: edges and texture lie at short lags, the zeros of a PSF at lags as long as its path (Rom, "On the cepstrum of
two-dimensional functions", IEEE Trans. Information Theory 21, 1975).
"""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsdeblur._util.threads import thread_count
from rsdeblur.estimate.sharpness import captured
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank

# Side of a tile, px, and the most of them along an axis; the picture is reduced until the paths are at most so long.
SIDE, MOST, LONGEST = 128, 8, 100.0
# Frequencies, cycles/px, and lags, px, that are compared: the finest are the camera's, short lags are the scene's.
BAND, LAGS = (0.03, 0.3), (4.0, SIDE / 3)
# Standard deviation of a tile of the blurred picture over its noise; with less there is nothing but noise.
LEAST_CONTRAST = 4.0
# Least power transfer of a PSF, below which its logarithm says nothing, and least power, so that black has one.
LEAST_TRANSFER, LEAST_POWER = 1e-3, 1e-9
# One in so many tiles is worse than the figure; fewer have no worst ones.
LEAST_TILES = 10

_FREQUENCY = np.hypot(fft.fftfreq(SIDE)[:, None], fft.rfftfreq(SIDE))
_LAG = SIDE * np.hypot(fft.fftfreq(SIDE)[:, None], fft.fftfreq(SIDE))
_IN_BAND, _COMPARED = np.digitize(_FREQUENCY, BAND) == 1, np.digitize(_LAG, LAGS) == 1
_WINDOW = np.outer(np.hanning(SIDE), np.hanning(SIDE)).astype(np.float32)


def cepstral_match(
    blurred: EncodedImage, sharp: EncodedImage, capture: Capture, noise: float, *, threads: int | None = None
) -> float | None:
    """Return the correlation of the cepstra of a result and of its PSFs in the worst tenth of the tiles.

    Pictures have their readout along y, `noise` is that of the blurred one, linear light. None where there are too few
    tiles that show more than noise.
    """
    step = int(np.ceil(capture.probe.lengths.max() / LONGEST))
    tops, lefts = corners = [spread(n // step, SIDE, MOST) for n in blurred.shape[:2]]
    shown = _tiles(blurred, tops, lefts, step).std(axis=(2, 3)) > LEAST_CONTRAST * noise / step
    if shown.sum() < LEAST_TILES:
        return None
    paths = BlurPaths.from_capture(captured(capture, 1 / step), *(each + (SIDE - 1) / 2 for each in corners))
    kernels = PsfBank.from_paths(paths, threads=1).kernels[shown]
    result = _tiles(sharp, tops, lefts, step)[shown]
    result -= np.tensordot(result, _WINDOW / _WINDOW.sum())[:, None, None]
    workers = thread_count(threads)
    spectra = fft.rfft2(_WINDOW * result, workers=workers), fft.rfft2(kernels, (SIDE, SIDE), workers=workers)
    leasts = LEAST_POWER * np.square(_WINDOW).sum(), LEAST_TRANSFER
    a, b = (_cepstra(spectrum, least, workers) for spectrum, least in zip(spectra, leasts, strict=True))
    matches = (a * b).sum(axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + LEAST_POWER)
    return float(np.quantile(matches, 1 / LEAST_TILES))


def spread(length: int, side: int, most: int) -> NDArray[np.intp]:
    """Return the first pixels of at most `most` cells that are spread over `length` px and overlap by half at most."""
    count = max(min(most, 2 * length // side - 1), 0)
    return np.round(np.linspace(0, length - side, count)).astype(np.intp)


def _tiles(encoded: EncodedImage, tops: NDArray[np.intp], lefts: NDArray[np.intp], step: int) -> NDArray[np.float32]:
    """Return tiles (B, S, SIDE, SIDE) of one channel, which says as much as all, linear light, reduced by a factor."""
    tiles, side = np.empty((len(tops), len(lefts), SIDE, SIDE), dtype=np.float32), SIDE * step
    channel = encoded.shape[2] // 2
    for b, s in np.ndindex(tiles.shape[:2]):
        rows, cols = (slice(n * step, n * step + side) for n in (tops[b], lefts[s]))
        light = EncodedImage(encoded.values[rows, cols, channel, None], encoded.transfer).linear(slice(None))
        tiles[b, s] = light.reshape(SIDE, step, SIDE, step).mean(axis=(1, 3))
    return tiles


def _cepstra(spectra: NDArray[np.complex64], least: float, workers: int) -> NDArray[np.float32]:
    """Return the cepstra (N, lags) of spectra within the band, at the lags that are compared."""
    logs = np.log(np.square(spectra.real) + np.square(spectra.imag) + np.float32(least))
    mean = logs[:, _IN_BAND].mean(axis=1)[:, None, None]
    cepstra = fft.irfft2(np.where(_IN_BAND, logs - mean, np.float32(0)), (SIDE, SIDE), workers=workers)
    return np.asarray(cepstra[:, _COMPARED], dtype=np.float32)
