"""Robust least squares of a clip's parameters, with errors that all points of a pair share.

The residual of a point is the sum of its own error and of four errors of its pair: a shift along x and y, a zoom and a
roll. The latter come from the camera's translation past things at one depth and from the gyro's noise, and are the same
for all points of a pair; a fit without them would believe in far too small deviations. Translation changes slowly, so
neighbouring pairs have nearly the same shared errors: each of the four is an autoregressive process of first order.
Shake that is faster than it then counts more. Variances and correlations are estimated from the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import least_squares

from rsdeblur.estimate.clip_motion import STEPS, ClipModel, Parameters
from rsdeblur.types import FloatArray

# Rounds in which weights and variances follow the residuals; they settle after three or four.
ROUNDS = 4
# Largest number of function evaluations in a round.
EVALUATIONS = 4
# Points are weighted down from about this many standard deviations (Cauchy, 95 % efficient for Gaussian errors), and
# pairs are left out whose shared errors exceed this many.
CAUCHY, OUTLYING = 2.385, 6.0
# Least standard deviation of a point, px: no tracker is better.
LEAST_NOISE = 0.02
# Deviation of a Gaussian variable over the median of its absolute values.
MAD = 1.4826
# Windows on one thing err alike in all frames that show it, and so do neighbouring windows. Over 24 simulated clips,
# errors of the parameters were 1.5 to 2.2 times the deviations of a fit that takes them as independent.
TEXTURE = 2.0
# Largest correlation of the shared errors of neighbouring pairs.
MOST_CORRELATION = 0.99
# Pairs are neighbours if their distance is no more than this many typical ones.
NEIGHBOURS = 1.5
# Pairs whose errors may still be correlated, about 0.1 s.
LAG = 4


@dataclass(frozen=True, slots=True, eq=False)
class ClipFit:
    """Result of :func:`fit_clip`.

    Parameters
    ----------
    parameters : Parameters
        All parameters, the free ones fitted.
    free : tuple of str
        Names of the free ones.
    covariance : ndarray, shape (free, free)
        Covariance of the free ones.
    residuals : ndarray, shape (n, 2)
        Predicted minus measured positions, px.
    used : ndarray of bool, shape (pairs,)
        Pairs that were not left out.
    """

    parameters: Parameters
    free: tuple[str, ...]
    covariance: FloatArray
    residuals: FloatArray
    used: NDArray[np.bool_]

    def sd(self, **slopes: float) -> float:
        """Return the standard deviation of a sum of parameters times `slopes`; those that are not free count as 0."""
        weights = np.array([slopes.get(name, 0.0) for name in self.free])
        return float(np.sqrt(weights @ self.covariance @ weights))


class PairErrors:
    """Weights of the points and shared errors of the pairs, estimated from residuals.

    Parameters
    ----------
    model : ClipModel
        The matches.
    residuals : ndarray, shape (n, 2)
        Predicted minus measured positions, px.
    keep : ndarray of bool, shape (pairs,)
        Pairs that may be used.

    Attributes
    ----------
    noise, weights : float and ndarray, shape (n,)
        Standard deviation of a point, px, and its weight: the variance of a point is noise^2 / weight.
    modes : ndarray, shape (n, 2, 4)
        Displacements of all points by a unit of each error that a pair shares.
    spread, correlation : ndarray, shapes (4,) and (pairs, 4)
        Variances of the shared errors, and their correlations with those of the pair before; 0 for the first.
    used : ndarray of bool, shape (pairs,)
        Pairs that were not left out.
    pairs : ndarray, shape (2 n + 4 pairs,)
        Pair of each row of whitened values.
    """

    def __init__(self, model: ClipModel, residuals: FloatArray, keep: NDArray[np.bool_]) -> None:
        self._starts, self.modes = model.matches.starts, _modes(model)
        own = residuals.copy()
        for _ in range(3):
            self.weights = self._weights(own)
            shared, variances = self._shared(residuals)
            own = residuals - np.einsum("nim,nm->ni", self.modes, shared[model.matches.pair])
        typical = np.median(shared[keep] ** 2, axis=0) * MAD**2
        self.used = keep & (shared**2 < OUTLYING**2 * (typical + variances)).all(axis=1)
        self.weights *= self.used[model.matches.pair]
        self.spread = np.maximum(typical - np.median(variances[keep], axis=0), 0.0)
        self.correlation = _correlations(model.matches.opens[:, 0], shared, variances, self.used)
        # Displacements of the weighted points, in their standard deviations, by one standard deviation of each error.
        scale = np.sqrt(self.weights)[:, None, None] / self.noise * np.sqrt(self.spread)
        self._scaled = (self.modes * scale).reshape(-1, 4)
        self._precision = cholesky_banded(self._banded_precision(), lower=True)
        pairs = np.arange(len(self._starts) - 1)
        self.pairs = np.concatenate([np.repeat(model.matches.pair, 2), np.repeat(pairs, 4)])

    def _weights(self, own: FloatArray) -> FloatArray:
        distance = np.linalg.norm(own, axis=1)
        self.noise = max(MAD * float(np.median(np.abs(own))), LEAST_NOISE)
        weights: FloatArray = 1.0 / (1.0 + (distance / (CAUCHY * self.noise)) ** 2)
        return weights

    def _shared(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shared errors of each pair, and their variances due to the points' own errors."""
        shared, variances = np.zeros((2, len(self._starts) - 1, 4))
        for k, ends in enumerate(pairwise(self._starts)):
            part = slice(*ends)
            modes, weights = self.modes[part], self.weights[part]
            normal = np.einsum("nim,n,nik->mk", modes, weights, modes) + 1e-9 * np.eye(4)
            inverse = np.linalg.inv(normal)
            shared[k] = inverse @ np.einsum("nim,n,ni->m", modes, weights, residuals[part])
            variances[k] = self.noise**2 * np.diag(inverse)
        return shared, variances

    def _banded_precision(self) -> FloatArray:
        """Return the precision of all shared errors given the points, in the lower form of `cholesky_banded`."""
        # Variances of the innovations, in units of those of the errors.
        innovation = 1.0 - self.correlation**2
        bands = np.zeros((5, *innovation.shape))
        for k, part in enumerate(self._parts()):
            gram = self._scaled[part].T @ self._scaled[part]
            for below in range(4):
                bands[below, k, : 4 - below] = np.diagonal(gram, -below)
        bands[0] += 1.0 / innovation
        bands[0, :-1] += 1.0 / innovation[1:] - 1.0
        bands[4, :-1] = -(self.correlation / innovation)[1:]
        return bands.reshape(5, -1)

    def _parts(self) -> list[slice]:
        """Return the rows of each pair's points."""
        return [slice(*ends) for ends in pairwise(2 * self._starts)]

    def whiten(self, values: FloatArray) -> FloatArray:
        """Return values, shape (n, 2, ...), whose errors are independent and of variance 1, shape (2 n + 4 pairs, ...).

        The likeliest shared errors are taken off the points, and their innovations are appended.
        """
        weight = (np.sqrt(self.weights) / self.noise).reshape(-1, *[1] * (values.ndim - 1))
        white = (values * weight).reshape(2 * len(values), -1)
        pulls = np.stack([self._scaled[part].T @ white[part] for part in self._parts()])
        solved = cho_solve_banded((self._precision, True), pulls.reshape(-1, white.shape[1]))
        shared = solved.reshape(pulls.shape)
        white = white - np.einsum("nm,nmk->nk", self._scaled, shared[self.pairs[: len(white)]])
        kept = self.correlation[..., None]
        innovations = (shared - kept * np.roll(shared, 1, axis=0)) / np.sqrt(1.0 - kept**2)
        return np.concatenate([white, innovations.reshape(-1, white.shape[1])]).reshape(-1, *values.shape[2:])


def _correlations(times: FloatArray, shared: FloatArray, variances: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return the correlations of the shared errors of each pair with those of the pair before it, shape (pairs, 4).

    They are estimated from neighbours, and fall exponentially with the time between pairs.
    """
    correlations = np.zeros_like(shared)
    if len(times) > 1:
        steps = np.diff(times) / np.median(np.diff(times))
        counted = used[1:] & used[:-1] & (steps < NEIGHBOURS)
        products = (shared[1:] * shared[:-1])[counted].sum(axis=0)
        power = shared**2 - variances
        power = 0.5 * (power[1:] + power[:-1])[counted].sum(axis=0)
        ratio = np.divide(products, power, out=np.zeros(4), where=power > 0)
        correlations[1:] = ratio.clip(0.0, MOST_CORRELATION) ** steps[:, None]
    return correlations


def _modes(model: ClipModel) -> FloatArray:
    """Return the displacements, shape (n, 2, 4), of all points by a unit of each error that a pair shares."""
    points = model.matches.moved
    centred = points - points.mean(axis=0)
    x, y = (centred / np.sqrt((centred**2).sum(axis=1).mean())).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    return np.stack([np.stack([one, zero, x, -y], axis=-1), np.stack([zero, one, y, x], axis=-1)], axis=1)


def fit_clip(
    model: ClipModel,
    start: Parameters,
    free: tuple[str, ...],
    keep: NDArray[np.bool_],
    *,
    rounds: int = ROUNDS,
) -> ClipFit:
    """Fit the free parameters.

    Parameters
    ----------
    model : ClipModel
        The matches and the gyro's orientations.
    start : Parameters
        Start values, and the values of those that are not free.
    free : tuple of str
        Names of the free ones.
    keep : ndarray of bool, shape (pairs,)
        Pairs that may be used.
    rounds : int
        Rounds of reweighting.
    """
    units = np.array([getattr(STEPS, name) for name in free])

    def at(x: FloatArray) -> Parameters:
        return start._replace(**dict(zip(free, (x * units).tolist(), strict=True)))

    def whitened(x: FloatArray, errors: PairErrors) -> FloatArray:
        return errors.whiten(model.residuals(at(x)))

    def slopes(x: FloatArray, errors: PairErrors) -> FloatArray:
        return errors.whiten(model.jacobian(at(x), free))

    x = np.array([getattr(start, name) for name in free]) / units
    for _ in range(rounds):
        errors = PairErrors(model, model.residuals(at(x)), keep)
        x = least_squares(whitened, x, slopes, method="lm", max_nfev=EVALUATIONS, args=(errors,)).x
    covariance = _covariance(slopes(x, errors), whitened(x, errors), errors.pairs) * np.outer(units, units)
    return ClipFit(at(x), free, covariance, model.residuals(at(x)), errors.used)


def _covariance(jacobian: FloatArray, residuals: FloatArray, pairs: NDArray[np.intp]) -> FloatArray:
    """Return the covariance times `TEXTURE` squared, of errors that are correlated over `LAG` pairs or independent.

    The larger of both counts. The former is the sandwich estimator of Newey and West (1987), whose sums over each pair
    are correlated with those of its neighbours. `pairs` holds the pair of each row.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    sums = np.zeros((pairs[-1] + 1, jacobian.shape[1]))
    np.add.at(sums, pairs, jacobian * residuals[:, None])
    middle = sums.T @ sums
    for lag in range(1, min(LAG, len(sums) - 1) + 1):
        product = sums[lag:].T @ sums[:-lag]
        middle += (1.0 - lag / (LAG + 1)) * (product + product.T)
    count, unknowns = sums.shape
    sandwich = inverse @ middle @ inverse * count / max(count - unknowns, 1)
    growth = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
    covariance: FloatArray = TEXTURE**2 * inverse * np.outer(growth, growth)
    return covariance
