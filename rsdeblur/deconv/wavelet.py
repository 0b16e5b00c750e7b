"""The learned prior in a wavelet frame: a few linear restorations, shrunk and added up, then two sparse steps.

Filters with a quadratic prior on the gradient restore the picture with a few weights, from sharp and noisy to smooth.
The results are shrunk in an undecimated Haar frame (:mod:`rsdeblur.kernels.frame`) and added up, with factors that were
learned once, by least squares over simulated pictures (``python -m benchmarks.train_wavelet``). Xue, Luisier and Blu
(2013) [1]_ introduced such a sum, and estimate its factors from the picture itself; that requires an exact model of the
blur, while learned factors allow for errors like those in the training.

The factors depend on one number, the weight of the gradient prior that suits the picture (:class:`rsdeblur.Tuning`),
which grows with its noise and with the errors of the model. Between the weights of the training they are interpolated
over its logarithm. Colour is turned into its mean and two differences, which have their own factors.

Linear restorations cannot bring back what the blur took away. So the sum is the start of the last two steps of a sparse
prior (:mod:`rsdeblur.deconv.priors`), which continue its edges into these frequencies.

.. [1] F. Xue, F. Luisier and T. Blu, "Multi-Wiener SURE-LET deconvolution", IEEE Trans. Image Processing 22, 2013.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rsdeblur._util import validate
from rsdeblur._util.threads import share, thread_count
from rsdeblur.errors import InputError
from rsdeblur.kernels.frame import GATES, HALO, LEVELS, ORIENTATIONS, WORK, combine, cut_block, put_block
from rsdeblur.kernels.lines import continued
from rsdeblur.types import Float32Array, FloatArray, FloatImage

if TYPE_CHECKING:
    from rsdeblur.deconv.priors import DerivativePrior, QuadraticSolver

FACTORS = Path(__file__).with_name("wavelet.json")
# Height and width of the blocks that a thread works on, px. With the halo, the planes take 4 MB.
BLOCK = 64, 256
# Largest variance of noise, the square of the largest value of a picture.
MOST_VARIANCE = validate.MOST_LIGHT**2
# Penalties of the sparse steps.
PENALTIES = 60.0, 300.0
# Brightness and two colour differences, an orthonormal basis.
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3.0], [2.0], [6.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """Learned factors.

    Parameters
    ----------
    ratios : ndarray, shape (K,)
        Weights of the gradient prior, as multiples of the weight; increasing.
    knots : ndarray, shape (Q,)
        Logarithms to base 10 of the weights at which the factors were learned, increasing.
    means : ndarray, shape (2, Q, K)
        Factors of the means of the last level, for brightness and for colour differences; the sum over K is 1.
    differences : ndarray, shape (2, Q, K, LEVELS, 2, 3)
        Factors of the differences: along one axis and along both, without a gate and with each gate.
    """

    ratios: FloatArray
    knots: FloatArray
    means: FloatArray
    differences: FloatArray

    @classmethod
    @cache
    def learned(cls) -> Factors:
        """Return the factors of the package."""
        return cls(**{name: np.array(values) for name, values in json.loads(FACTORS.read_text()).items()})

    def at(self, weight: float) -> tuple[Float32Array, Float32Array]:
        """Return the factors for a weight: those of the means (2, K), of the differences (2, K, LEVELS, 3, 3)."""
        shares = hats(weight, self.knots)
        means, differences = (np.tensordot(shares, each, (0, 1)) for each in (self.means, self.differences))
        # The differences across and down have the same factors.
        return means.astype(np.float32), differences[:, :, :, [0, 0, 1]].astype(np.float32)


def hats(weight: float, knots: FloatArray) -> FloatArray:
    """Return the shares of the knots (Q,) in a linear interpolation at the logarithm of `weight`."""
    return np.array([np.interp(np.log10(weight), knots, unit) for unit in np.eye(len(knots))])


@dataclass(frozen=True, slots=True)
class WaveletPrior:
    """The learned prior, with what it must know of a picture. :meth:`rsdeblur.Tuning.wavelet` makes one.

    Parameters
    ----------
    weight : float
        Weight of the gradient prior that suits the picture, from 1e-20 to 1e20: larger is smoother.
    variances : sequence of float
        Variances of the noise of the frame's coefficients, from 0 to 1e24, K x LEVELS x 3 of them, see
        :func:`band_shape`.
    sparse : DerivativePrior
        Prior of the last steps, "tv" or "hyper-laplacian".

    Raises
    ------
    InputError
        If an argument is out of range.
    """

    weight: float
    variances: tuple[float, ...]
    sparse: DerivativePrior

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", validate.strength("weight", self.weight))
        values = validate.real_array("variances", self.variances, most=MOST_VARIANCE)
        if values.size != np.prod(band_shape()) or (values < 0).any():
            raise InputError(f"variances must be {np.prod(band_shape())} numbers of at least 0, got {self.variances}")
        object.__setattr__(self, "variances", tuple(values.ravel().tolist()))

    def with_peak_of(self, image: FloatImage) -> WaveletPrior:
        """Return this prior with the brightness of a picture, on which the sparse steps depend, unless it has one."""
        return replace(self, sparse=self.sparse.with_peak_of(image))

    def restore(
        self,
        solver: QuadraticSolver,
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Return the restored picture, see :meth:`rsdeblur.deconv.priors.LatentPrior.restore`."""
        factors = Factors.learned()
        solves = len(factors.ratios) + len(PENALTIES)
        latents = []
        for done, ratio in enumerate(factors.ratios, 1):
            latents.append(solver.solve(self.weight * float(ratio)))
            if progress is not None:
                progress(done / solves)
        variances = np.array(self.variances, dtype=np.float32).reshape(band_shape())
        means, differences = factors.at(self.weight)
        out = np.empty_like(latents[0])
        _combine(latents, variances, means, differences, solver.periodic, out, threads)
        del latents
        steps = self.sparse.steps(solver, start=out, penalties=PENALTIES, ahead=0.0, threads=threads)
        for done, step in enumerate(steps, len(factors.ratios) + 1):
            out = step.latent
            if progress is not None:
                progress(done / solves)
        return out


def median_prior(priors: Sequence[WaveletPrior], peak: float) -> WaveletPrior:
    """Return the prior whose numbers are medians of those of others, for pictures whose bright parts have one value.

    Parameters
    ----------
    priors : sequence of WaveletPrior
        At least one.
    peak : float
        Value of the bright parts.
    """
    weight, sparse = (
        float(np.median(weights))
        for weights in ([each.weight for each in priors], [each.sparse.weight for each in priors])
    )
    variances = np.median([each.variances for each in priors], axis=0)
    return WaveletPrior(weight, tuple(variances.tolist()), replace(priors[0].sparse, weight=sparse, peak=peak))


def band_shape() -> tuple[int, int, int]:
    """Return the shape (K, LEVELS, 3) of arrays with one value for each restoration, level and orientation."""
    return len(Factors.learned().ratios), LEVELS, ORIENTATIONS


def frame_responses(side: int) -> FloatArray:
    """Return the squared frequency responses of the frame's coefficients, shape (LEVELS, 3, side, side)."""
    angle = np.pi * np.fft.fftfreq(side)
    low = np.ones((side, side))
    levels = []
    for level in range(LEVELS):
        mean, difference = np.cos(angle * 2**level) ** 2, np.sin(angle * 2**level) ** 2
        pairs = ((mean, difference), (difference, mean), (difference, difference))
        levels.append([low * down[:, None] * across for down, across in pairs])
        low = low * mean[:, None] * mean
    return np.array(levels)


def _combine(
    latents: Sequence[FloatImage],
    variances: Float32Array,
    means: Float32Array,
    differences: Float32Array,
    periodic: bool,
    out: FloatImage,
    threads: int | None,
) -> None:
    """Fill `out` (H, W, C) with the sum of the shrunk latents; threads share blocks."""
    height, width, channels = out.shape
    tall, wide = min(BLOCK[0], height), min(BLOCK[1], width)
    mix = (OPPONENT if channels == 3 else np.eye(channels)).astype(np.float32)
    down, across = (continued(np.arange(-HALO, n + HALO), n, periodic=periodic) for n in (height, width))
    corners = [(top, left) for top in range(0, height, tall) for left in range(0, width, wide)]
    size = tall + 2 * HALO, wide + 2 * HALO
    count = min(thread_count(threads), len(corners))
    planes = np.empty((count, channels, len(latents), *size), dtype=np.float32)
    work = np.zeros((count, WORK + len(latents), *size), dtype=np.float32)
    results = np.empty((count, channels, tall, wide), dtype=np.float32)

    def block(thread: int, n: int) -> None:
        # The last blocks end where the picture ends, so that all have one size.
        top, left = min(corners[n][0], height - tall), min(corners[n][1], width - wide)
        for k, latent in enumerate(latents):
            cut_block(latent, down[top : top + size[0]], across[left : left + size[1]], mix, planes[thread, :, k])
        for c, result in enumerate(results[thread]):
            kind = 1 if channels == 3 and c > 0 else 0
            combine(planes[thread, c], 9 * variances, means[kind], differences[kind], GATES, work[thread], result)
        put_block(results[thread], mix, out[top : top + tall, left : left + wide])

    share(block, range(len(corners)), threads)
