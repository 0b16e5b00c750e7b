"""Robust least squares of a clip's parameters, with errors that all points of a pair share.

The residual of a point is the sum of its own error and of four errors of its pair: a shift along x and y, a zoom and a
roll. The latter come from the camera's translation past things at one depth and from the gyro's noise, and are the same
for all points of a pair; a fit without them would believe in far too small deviations. Their variances are estimated
from the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
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
# Pairs whose errors may be correlated: a hand's translation changes within about 0.1 s.
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


class _Errors:
    """Weights of the points and shared errors of the pairs, estimated from residuals."""

    def __init__(self, model: ClipModel, residuals: FloatArray, keep: NDArray[np.bool_]) -> None:
        self._starts, self._modes = model.matches.starts, _modes(model)
        own = residuals.copy()
        for _ in range(3):
            self.weights = self._weights(own)
            shared, variances = self._shared(residuals)
            own = residuals - np.einsum("nim,nm->ni", self._modes, shared[model.matches.pair])
        typical = np.median(shared[keep] ** 2, axis=0) * MAD**2
        self.used = keep & (shared**2 < OUTLYING**2 * (typical + variances)).all(axis=1)
        self.weights *= self.used[model.matches.pair]
        spread = np.maximum(typical - np.median(variances[keep], axis=0), 0.0)
        self._factors = [self._factor(slice(*ends), np.sqrt(spread)) for ends in pairwise(self._starts)]

    def _weights(self, own: FloatArray) -> FloatArray:
        distance = np.linalg.norm(own, axis=1)
        self._noise = max(MAD * float(np.median(np.abs(own))), LEAST_NOISE)
        weights: FloatArray = 1.0 / (1.0 + (distance / (CAUCHY * self._noise)) ** 2)
        return weights

    def _shared(self, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the shared errors of each pair, and their variances due to the points' own errors."""
        shared, variances = np.zeros((2, len(self._starts) - 1, 4))
        for k, ends in enumerate(pairwise(self._starts)):
            part = slice(*ends)
            modes, weights = self._modes[part], self.weights[part]
            normal = np.einsum("nim,n,nik->mk", modes, weights, modes) + 1e-9 * np.eye(4)
            inverse = np.linalg.inv(normal)
            shared[k] = inverse @ np.einsum("nim,n,ni->m", modes, weights, residuals[part])
            variances[k] = self._noise**2 * np.diag(inverse)
        return shared, variances

    def _factor(self, part: slice, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return U and g for which `r - U g U'r` makes the errors of a pair independent, of variance 1."""
        scaled = self._modes[part] * np.sqrt(self.weights[part])[:, None, None] / self._noise * spread
        u, size, _ = np.linalg.svd(scaled.reshape(-1, 4), full_matrices=False)
        return u, 1.0 - 1.0 / np.sqrt(1.0 + size**2)

    def whiten(self, values: FloatArray) -> FloatArray:
        """Return values, shape (n, 2, ...), whose errors are independent and of variance 1, shape (2 n, ...)."""
        weight = (np.sqrt(self.weights) / self._noise).reshape(-1, *[1] * (values.ndim - 1))
        white = (values * weight).reshape(2 * len(values), *values.shape[2:])
        for (u, g), first, stop in zip(self._factors, 2 * self._starts, 2 * self._starts[1:], strict=False):
            white[first:stop] -= u @ (g * (u.T @ white[first:stop]).T).T
        return white


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

    def whitened(x: FloatArray, errors: _Errors) -> FloatArray:
        return errors.whiten(model.residuals(at(x)))

    def slopes(x: FloatArray, errors: _Errors) -> FloatArray:
        return errors.whiten(model.jacobian(at(x), free))

    x = np.array([getattr(start, name) for name in free]) / units
    for _ in range(rounds):
        errors = _Errors(model, model.residuals(at(x)), keep)
        x = least_squares(whitened, x, slopes, method="lm", max_nfev=EVALUATIONS, args=(errors,)).x
    covariance = _covariance(slopes(x, errors), whitened(x, errors), 2 * model.matches.starts) * np.outer(units, units)
    return ClipFit(at(x), free, covariance, model.residuals(at(x)), errors.used)


def _covariance(jacobian: FloatArray, residuals: FloatArray, starts: NDArray[np.intp]) -> FloatArray:
    """Return the covariance times `TEXTURE` squared, of errors that are correlated over `LAG` pairs or independent.

    The larger of both counts.

    The former is the sandwich estimator of Newey and West (1987), whose sums over each pair are correlated with those
    of its neighbours.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    sums = np.stack([jacobian[a:b].T @ residuals[a:b] for a, b in pairwise(starts)])
    middle = sums.T @ sums
    for lag in range(1, min(LAG, len(sums) - 1) + 1):
        product = sums[lag:].T @ sums[:-lag]
        middle += (1.0 - lag / (LAG + 1)) * (product + product.T)
    pairs, unknowns = sums.shape
    sandwich = inverse @ middle @ inverse * pairs / max(pairs - unknowns, 1)
    growth = np.sqrt(np.maximum(np.diag(sandwich) / np.diag(inverse), 1.0))
    covariance: FloatArray = TEXTURE**2 * inverse * np.outer(growth, growth)
    return covariance
