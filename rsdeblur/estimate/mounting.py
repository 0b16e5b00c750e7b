"""Search of the IMU's mounting and of the clock offset: the rotation between frames against the log's.

The 48 candidates take each camera axis from an IMU axis with either sign; half of them mirror, which is right for a log
with left-handed axes. The focal length scales the rotation about x and y that the picture shows, so it is left free
within a factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.estimate.clip_fit import ClipFit
from rsdeblur.estimate.clip_matches import ClipMatches
from rsdeblur.motion.axes import letters, mountings
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray

# Step of the offsets, s: a twentieth of the period of 12 Hz, the fastest tremor of a hand.
STEP = 4e-3
# Range of the start's focal length over the true one.
LEAST_SCALE, MOST_SCALE = 0.5, 2.0
# Offsets nearer than this are refined to the same answer, s.
SAME = 0.03
# Refined offsets nearer than this are one answer, s.
ONE_ANSWER = 0.01
# Resamplings of the pairs for the confidence, the least confidence, and the least lead, in nats over all pairs.
RESAMPLES, CONFIDENT, LEAST_LEAD = 200, 0.95, 3.0
# Least share of the energy of the points' motion that the log explains.
LEAST_EXPLAINED = 0.5
# Rounds of reweighting of a pair's rotation, and the residual in px that halves a weight.
ROUNDS, HALF = 6, 1.0


class Candidate(NamedTuple):
    """A mounting and an offset that may explain the rotation between frames.

    Parameters
    ----------
    mounting : ndarray, shape (3, 3)
        Orthogonal matrix from IMU axes to camera axes; its determinant is -1 for a left-handed log.
    offset : float
        Camera time minus gyro time, s.
    unexplained : float
        Share of the energy of the motion that it leaves.
    """

    mounting: FloatArray
    offset: float
    unexplained: float

    @property
    def mirrors(self) -> bool:
        """Whether the log's axes are left-handed."""
        return bool(np.linalg.det(self.mounting) < 0)


def frame_rotations(matches: ClipMatches, camera: Camera) -> FloatArray:
    """Return the camera's rotation vector between the frames of each pair, rad, camera axes, shape (pairs, 3)."""
    rays = camera.rays(matches.points)
    ahead = camera.rays(matches.moved)
    plane, step = rays[:, :2] / rays[:, 2:], ahead[:, :2] / ahead[:, 2:] - rays[:, :2] / rays[:, 2:]
    x, y = plane.T
    one = np.ones_like(x)
    # A point X moves by -theta x X; these are the motions of x/z and y/z for a unit of theta_x, theta_y, theta_z.
    slopes = np.stack([np.stack([x * y, -(one + x * x), y], -1), np.stack([one + y * y, -x * y, -x], -1)], axis=1)
    rotations = np.zeros((len(matches.opens), 3))
    for k, (a, b) in enumerate(pairwise(matches.starts)):
        weights = np.ones(b - a)
        for _ in range(ROUNDS):
            weighted = slopes[a:b] * weights[:, None, None]
            normal = np.einsum("nik,nil->kl", weighted, slopes[a:b]) + 1e-9 * np.eye(3)
            rotations[k] = np.linalg.solve(normal, np.einsum("nik,ni->k", weighted, step[a:b]))
            error = np.linalg.norm(step[a:b] - slopes[a:b] @ rotations[k], axis=1) * camera.focal_length[0]
            weights = 1.0 / (1.0 + (error / HALF) ** 2)
    return rotations


class MountingSearch:
    """Comparison of the rotation between frames with the log's, for all offsets of a range.

    Parameters
    ----------
    matches : ClipMatches
        The matches.
    camera : Camera
        Start values of focal length and lens.
    t, omega : ndarray, shapes (n,) and (n, 3)
        The log: times in s from the origin of the matches' times, and rates in rad/s, IMU axes.
    search : (float, float)
        First and last offset, s.
    """

    def __init__(
        self, matches: ClipMatches, camera: Camera, t: FloatArray, omega: FloatArray, search: tuple[float, float]
    ) -> None:
        step = np.diff(t)[:, None]
        angle = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * step * (omega[1:] + omega[:-1]), axis=0)])
        middles = matches.opens + 0.5 * matches.durations
        self.offsets = np.arange(search[0], search[1] + STEP, STEP)
        times = middles - self.offsets[:, None, None]
        turned = np.stack([np.interp(times, t, axis) for axis in angle.T], axis=-1)
        interval = np.diff(middles, axis=1)
        gyro = _without_constant_rate(turned[:, :, 1] - turned[:, :, 0], interval)
        seen = _without_constant_rate(frame_rotations(matches, camera), interval)
        # Motion in px that a rotation causes, typical of all points.
        x, y = (camera.rays(matches.points)[:, :2]).T
        self._reach = np.array([1.0, 1.0, float((x * x + y * y).mean())])
        # Pairs with wild rotations, which were matched wrongly, count no more than others.
        size = np.sqrt(seen**2 @ self._reach)
        seen = seen * np.minimum(1.0, 5.0 * np.median(size) / np.maximum(size, 1e-12))[:, None]
        self._cross = np.einsum("ki,okj->oij", seen, gyro)
        self._energy = np.einsum("oki,oki->oi", gyro, gyro)
        self._seen = (seen**2).sum(axis=0)

    def unexplained(self, mounting: FloatArray) -> FloatArray:
        """Return the share of the seen motion's energy that remains under each offset."""
        agreement = np.einsum("oij,ij->oi", self._cross, mounting)
        energy = self._energy @ (mounting**2).T
        along, across = agreement[:, :2].sum(axis=1), energy[:, :2].sum(axis=1)
        scale = np.clip(along / np.maximum(across, 1e-12), LEAST_SCALE, MOST_SCALE)
        tilt = self._seen[:2].sum() - 2 * scale * along + scale**2 * across
        roll = self._seen[2] - 2 * agreement[:, 2] + energy[:, 2]
        total = self._seen @ self._reach
        share: FloatArray = (tilt + self._reach[2] * roll) / max(float(total), 1e-12)
        return share

    def candidates(self, count: int, more: tuple[FloatArray, ...] = ()) -> list[Candidate]:
        """Return the `count` best candidates, the best first, no two of them with one mounting and nearly one offset.

        Parameters
        ----------
        count : int
            Number of candidates.
        more : tuple of ndarray, shape (3, 3)
            Mountings beside the 48.
        """
        found = []
        for mounting in (*more, *mountings()):
            share = self.unexplained(mounting)
            for place in _minima(share):
                found.append(Candidate(mounting, float(self.offsets[place]), float(share[place])))
        found.sort(key=lambda each: each.unexplained)
        best: list[Candidate] = []
        for each in found:
            near = [b for b in best if np.allclose(b.mounting, each.mounting) and abs(b.offset - each.offset) < SAME]
            if not near:
                best.append(each)
            if len(best) == count:
                break
        return best


class Ranking(NamedTuple):
    """The best candidate.

    Parameters
    ----------
    best : Candidate
        The candidate.
    fit : ClipFit
        Its fit to some of the matches.
    confidence : float
        Share of resamplings of the pairs in which it leads all others.
    explained : float
        Share of the energy of the motion that it explains.
    reason : str
        Why it cannot be trusted; empty if it can.
    name : str
        Name of its mounting.
    """

    best: Candidate
    fit: ClipFit
    confidence: float
    explained: float
    reason: str
    name: str

    @classmethod
    def of(cls, candidates: Sequence[Candidate], fits: Sequence[ClipFit], matches: ClipMatches) -> Ranking:
        """Compare refined candidates by the errors of their points, pair by pair."""
        energy = np.array([(fit.residuals**2).sum(axis=1) for fit in fits])
        scale = np.median(energy, axis=1).min() + 1e-4
        # Log-likelihoods in nats whose tails let wrong points be; all points of a pair together count as one.
        cost = np.log1p(energy / scale)
        pairs = len(matches.opens)
        counts = np.bincount(matches.pair, minlength=pairs)
        costs = np.array([np.bincount(matches.pair, each, pairs) for each in cost]) / np.maximum(counts, 1)
        order = np.argsort(costs.sum(axis=1))
        best = int(order[0])

        def same(i: int) -> bool:
            near = abs(fits[i].parameters.offset - fits[best].parameters.offset) < ONE_ANSWER
            return near and np.array_equal(candidates[i].mounting, candidates[best].mounting)

        rivals = [int(i) for i in order if not same(int(i))]
        draws = np.random.default_rng(0).multinomial(pairs, np.full(pairs, 1 / pairs), RESAMPLES)
        leads = (costs[rivals] - costs[best]) @ draws.T
        confidence = float(np.mean(np.min(leads, axis=0, initial=np.inf) > LEAST_LEAD))
        share = explained_share(matches, fits[best].residuals, counts > 0)
        ranking = cls(candidates[best], fits[best], confidence, share, "", mounting_name(candidates[best].mounting))
        return ranking._replace(reason=ranking._doubt(candidates[rivals[0]], fits[rivals[0]]))

    def _doubt(self, rival: Candidate, fit: ClipFit) -> str:
        """Return why the best candidate cannot be trusted, given its best rival; empty if it can."""
        if self.explained < LEAST_EXPLAINED:
            return (
                f"the log explains only {max(self.explained, 0):.0%} of the motion between frames: it belongs to "
                "another clip, the video is stabilised, the scene is near or moves, or the offset is outside the search"
            )
        if self.confidence < CONFIDENT:
            away = f"{1e3 * (fit.parameters.offset - self.fit.parameters.offset):+.0f} ms"
            return (
                f"the clip does not decide between the axes {self.name} and {mounting_name(rival.mounting)}, the "
                f"latter with a time offset {away} away; turn the camera about all three axes, unevenly"
            )
        if self.best.mirrors:
            return (
                f"the log has left-handed axes: read it with --orientation {self.name} (orientation={self.name!r}), "
                "and calibrate again"
            )
        return ""


def mounting_name(mounting: FloatArray) -> str:
    """Return the orientation string of a mounting, or that it is the start's, whose axes are not parallel."""
    return letters(mounting) if np.isin(mounting, (-1.0, 0.0, 1.0)).all() else "of the start"


def explained_share(matches: ClipMatches, residuals: FloatArray, pairs: NDArray[np.bool_]) -> float:
    """Return the share of the energy of the motion in `pairs` that a fit with these residuals explains.

    The median over the points of a pair resists wrong matches.
    """
    left, whole = 0.0, 0.0
    for k, (a, b) in enumerate(pairwise(matches.starts)):
        if pairs[k]:
            left += float(np.median((residuals[a:b] ** 2).sum(axis=1)))
            whole += float(np.median((matches.flow[a:b] ** 2).sum(axis=1)))
    return 1.0 - left / max(whole, 1e-12)


def _without_constant_rate(rotations: FloatArray, interval: FloatArray) -> FloatArray:
    """Return rotations, shape (..., pairs, 3), less the constant rate that fits best: it may be the gyro's bias."""
    rate = (interval * rotations).sum(axis=-2, keepdims=True) / (interval**2).sum()
    changing: FloatArray = rotations - rate * interval
    return changing


def _minima(values: FloatArray) -> NDArray[np.intp]:
    """Return the places of the local minima, the ends included."""
    padded = np.pad(values, 1, constant_values=np.inf)
    (places,) = np.nonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] < padded[2:]))
    return places
