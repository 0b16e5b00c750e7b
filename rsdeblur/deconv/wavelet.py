"""The learned prior in a wavelet frame: linear restorations, shrunk and added up, two sparse steps, and a second sum.

Filters with a quadratic prior on the gradient restore the picture with a few weights, from sharp and noisy to smooth.
The results are shrunk in an undecimated Haar frame (:mod:`rsdeblur.kernels.frame`) and added up, with factors that were
learned once, by least squares over simulated pictures (``python -m benchmarks.train_wavelet``). Xue, Luisier and Blu
(2013) [1]_ introduced such a sum, and estimate its factors from the picture itself; that requires an exact model of the
blur, while learned factors allow for errors like those in the training.

The factors depend on two numbers: the weight of the gradient prior that suits the picture
(:class:`rsdeblur.tuning.Tuning`), which grows with its noise and with the errors of the model, and the share that the
noise has in both. Between the weights of the training they are interpolated over its logarithm; in the share they are
linear. Colour is turned into its mean and two differences, which have their own factors.

Linear restorations cannot bring back what the blur took away. So the sum is the start of the last two steps of a sparse
prior (:mod:`rsdeblur.deconv.priors`), which continue its edges into these frequencies. Their result is the pilot of a
second sum in the frame: it has little noise, so its energies tell where the middle restoration holds texture that the
sparse prior took away, and that one is shrunk and added to it, with learned factors again.

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
from rsdeblur._util.threads import share_blocks
from rsdeblur.kernels.frame import HALO, LEVELS, combine
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
# The linear restoration in the second sum.
MIDDLE = 1
# Brightness and two colour differences, an orthonormal basis.
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3.0], [2.0], [6.0]])


@dataclass(frozen=True, slots=True, eq=False)
class FrameSum:
    """Learned factors of a sum of K shrunk pictures; each is a linear function of Q features."""

    # Factors of the means of the last level (2, Q, K), for brightness and for colour differences.
    means: FloatArray
    # Factors of the differences (2, Q, K, LEVELS, 2, 3): along one axis and along both, without and with each gate.
    differences: FloatArray

    def at(self, features: FloatArray) -> tuple[Float32Array, Float32Array]:
        """Return the factors for features (Q,): those of the means (2, K), of the differences (2, K, LEVELS, 3, 3).

        Those of the means sum to 1.
        """
        means, differences = (np.tensordot(features, each, (0, 1)) for each in (self.means, self.differences))
        # The differences across and down have the same factors.
        return means.astype(np.float32), differences[:, :, :, [0, 0, 1]].astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """All learned factors."""

    ratios: FloatArray  # weights of the gradient prior, as multiples of the weight (K,), increasing
    knots: FloatArray  # logarithms to base 10 of the weights at which the factors were learned (Q - 1,), increasing
    linear: FrameSum  # sum of the K linear restorations
    piloted: FrameSum  # sum of the restoration `MIDDLE` and the result of the sparse steps

    @classmethod
    @cache
    def learned(cls) -> Factors:
        """Return the factors of the package."""
        stored = json.loads(FACTORS.read_text())
        linear, piloted = (
            FrameSum(**{name: np.array(values) for name, values in stored[part].items()})
            for part in ("linear", "piloted")
        )
        return cls(np.array(stored["ratios"]), np.array(stored["knots"]), linear, piloted)


def features(weight: float, noise_share: float, knots: FloatArray) -> FloatArray:
    """Return the features (Q,) of a picture.

    They are the shares of the knots in a linear interpolation at the logarithm of `weight`, and `noise_share` about its
    middle.
    """
    hats = [np.interp(np.log10(weight), knots, unit) for unit in np.eye(len(knots))]
    return np.array([*hats, noise_share - 0.5])


@dataclass(frozen=True, slots=True, eq=False)
class WaveletPrior:
    """The learned prior, with what it must know of a picture. :meth:`rsdeblur.tuning.Tuning.wavelet` makes one."""

    # Weight of the gradient prior that suits the picture, from 1e-20 to 1e20: larger is smoother.
    weight: float
    # Variances of the noise of the frame's coefficients (K, LEVELS, 3), from 0 to 1e24.
    variances: Float32Array
    # Share of the noise in the power of noise and of the model's errors, from 0 to 1.
    noise_share: float
    # Prior of the sparse steps, "tv" or "hyper-laplacian".
    sparse: DerivativePrior

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
        place, variances = features(self.weight, self.noise_share, factors.knots), self.variances
        pilot = add_up(latents, variances, factors.linear.at(place), periodic=solver.periodic, threads=threads)
        middle = latents[MIDDLE]
        del latents
        steps = self.sparse.steps(solver, start=pilot, penalties=PENALTIES, ahead=0.0, threads=threads)
        for done, step in enumerate(steps, len(factors.ratios) + 1):
            pilot = step[0]
            if progress is not None:
                progress(done / solves)
        return add_up(
            *([middle, pilot], variances[[MIDDLE, MIDDLE]], factors.piloted.at(place)),
            periodic=solver.periodic,
            threads=threads,
        )


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


def add_up(
    latents: Sequence[FloatImage],
    variances: Float32Array,
    factors: tuple[Float32Array, Float32Array],
    *,
    periodic: bool,
    threads: int | None,
) -> FloatImage:
    """Return the sum of the shrunk `latents`, K pictures (H, W, C), least regularised first.

    The energies of each gate the one before; those of the last one gate that one, too. `variances` (K, LEVELS, 3) are
    those of the noise of their coefficients, `factors` those of :meth:`FrameSum.at`. Pictures that are not periodic are
    mirrored at the border.
    """
    (height, width, channels), (means, differences) = latents[0].shape, factors
    out = np.empty_like(latents[0])
    mix = (OPPONENT if channels == 3 else np.eye(channels)).astype(np.float32)
    down, across = (continued(np.arange(-HALO, n + HALO), n, periodic=periodic) for n in (height, width))

    def block(_: int, rows: slice, columns: slice) -> None:
        near = np.ix_(*(line[at.start : at.stop + 2 * HALO] for line, at in ((down, rows), (across, columns))))
        planes = [np.ascontiguousarray(np.moveaxis(latent[near] @ mix.T, -1, 0)) for latent in latents]
        mixed = []
        for c in range(channels):
            kind = 1 if channels == 3 and c > 0 else 0
            mixed.append(combine([plane[c] for plane in planes], 9 * variances, means[kind], differences[kind]))
        out[rows, columns] = np.stack(mixed, axis=-1) @ mix

    share_blocks(block, (height, width), BLOCK, threads)
    return out
