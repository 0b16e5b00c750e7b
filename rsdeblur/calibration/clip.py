"""Calibration of camera, clock and IMU from a clip: the motion between its frames against the gyro log.

Unlike in the works that :func:`calibrate` names, the search of clock and mounting comes first, so no start values are
needed, and the errors that all points of two frames share have a variance of their own, so translation of the camera
widens the deviations instead of hiding in them (docs/theory/estimates.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from rsdeblur._util import validate
from rsdeblur.calibration.fit import ClipFit, ClipModel, MeanOrientation, Parameters, fit_clip
from rsdeblur.calibration.matches import LONGEST_STEP, ClipMatches, match_clip
from rsdeblur.calibration.result import (
    CONFIDENT,
    OBLIQUE,
    Calibration,
    Estimate,
    confidence,
    left_handed,
    mounting_name,
)
from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.errors import ClockError, InputError
from rsdeblur.motion.arguments import exposure_list
from rsdeblur.motion.axes import mountings
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Least number of pairs of frames.
LEAST_PAIRS = 5
# Mountings with an offset that are fitted before the best of them is chosen, and matches of a pair that suffice for it.
CANDIDATES, FEW = 8, 20
# Step of the offsets, s: a twentieth of the period of 12 Hz, the fastest tremor of a hand.
STEP = 4e-3
# Offsets nearer than this are one answer, s.
SAME = 0.02
# Least lead of a mounting over all pairs of frames, nats.
LEAST_LEAD = 3.0
# Margin of the log around a pair, s, within which the offset may move in the fit.
MARGIN = 0.05
# Least share of the motion that the log explains.
LEAST_EXPLAINED = 0.5
# A group of parameters counts as determined below this standard deviation of each (s, rad and their ratios); otherwise
# it keeps its start value. Of the readout time, this share will do as well.
LIMITS = {
    ("offset",): 3e-3,
    ("down", "across"): 1e-3,
    ("focal",): 0.03,
    ("turn_x", "turn_y", "turn_z"): 0.0175,
    ("bias_x", "bias_y", "bias_z"): 0.01,
    ("drift",): 2e-5,
}
READOUT_SHARE = 0.1
OFFSET, READOUT, FOCAL, TURN, BIAS, DRIFT = LIMITS
# A readout time or a turn nearer to zero than this many standard deviations is zero.
SIGNIFICANT = 3.0


def calibrate(
    frames: Iterable[ArrayLike],
    exposures: Sequence[Exposure],
    log: GyroLog,
    camera: Camera,
    *,
    search: tuple[float, float] = (-1.0, 1.0),
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a camera from the frames of a clip, sharp or blurred, and the gyro log.

    Clock offset, mounting, readout time and direction, focal length, gyro bias and clock drift follow from the motion
    between neighbouring frames. A few seconds of a textured, mostly distant and still scene suffice, if the camera
    turns about all of its axes.

    Parameters
    ----------
    frames : iterable of array_like, shape (H, W) or (H, W, C)
        The frames in the order of time, as for :func:`rsdeblur.deblur`. They are taken one by one. Neighbours more than
        0.6 s apart are not compared, so a long clip may be given as several short runs.
    exposures : sequence of Exposure
        Time of each frame.
    log : GyroLog
        Motion of the camera.
    camera : Camera
        Start values. Size, lens distortion, principal point and `timestamp_marks` are kept as they are; the focal
        length may be wrong by a factor of 1.5, and mounting, readout and `time_offset` need not be known.
    search : (float, float)
        First and last offset relative to `camera.time_offset`, s.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    Calibration
        Camera and log for :func:`rsdeblur.deblur`, each number with its standard deviation.

    Raises
    ------
    InputError
        If an argument is out of range, a frame does not have the camera's size, or there is not one exposure for each
        frame.
    ClockError
        If the log covers no frame under any offset of the search.

    Notes
    -----
    A point at x in a frame is predicted at `K C(t2) C(t1)^T K^-1 x` in the next one, where
    `t = start + readout row / H - offset` for the row in which each frame shows it, and C is the orientation from the
    log, averaged over the exposure. The offset and the 48 mountings are compared by the rotation between frames first;
    the best are refined by robust least squares over all points.

    References
    ----------
    .. [1] A. Karpenko, D. Jacobs, J. Baek and M. Levoy, "Digital video stabilization and rolling shutter correction
       using gyroscopes", Stanford CSTR 2011-03 (2011).
    .. [2] C. Jia and B. L. Evans, "Online camera-gyroscope autocalibration for cell phones", IEEE Trans. Image
       Processing 23 (2014) 5070-5081.
    .. [3] P.-E. Forssen and E. Ringaby, "Rectifying rolling shutter video from hand-held devices", CVPR (2010).

    Examples
    --------
    >>> import rsdeblur
    >>> found = rsdeblur.calibrate(frames, exposures, log, rsdeblur.Camera(640, 480, 500.0))  # doctest: +SKIP
    >>> found.camera.save("camera.toml")  # doctest: +SKIP
    """
    validate.instance("log", log, GyroLog)
    validate.instance("camera", camera, Camera)
    exposures = exposure_list(exposures)
    first, last = validate.real_array("search", search, (2,)).tolist()
    validate.callback("progress", progress)
    if last <= first:
        raise InputError(f"search must run from a smaller to a larger offset, got {first:g} to {last:g}")
    matches = match_clip(frames, exposures, camera, progress)
    epoch_ns = exposures[0].epoch_ns if exposures else 0
    around = (first + camera.time_offset, last + camera.time_offset)
    return calibrate_matches(matches, epoch_ns, log, camera, around, progress)


def calibrate_matches(
    matches: ClipMatches,
    epoch_ns: int,
    log: GyroLog,
    camera: Camera,
    search: tuple[float, float],
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate from the matches of a clip, whose times count from `epoch_ns`; see :func:`calibrate` for the rest."""
    pairs = len(matches.opens)
    nothing = Calibration(False, "", camera, log, pairs=pairs, matches=len(matches.pair))
    if pairs < LEAST_PAIRS:
        reason = (
            f"only {pairs} pairs of neighbouring frames show the same things; {LEAST_PAIRS} are needed, at most "
            f"{LONGEST_STEP:g} s apart"
        )
        return replace(nothing, reason=reason)
    return _Clip(matches, epoch_ns, log, nothing, search, progress or (lambda *_: None)).calibration()


class _Clip:
    """The matches with the log on one clock, and the steps from the search to the final fit."""

    def __init__(
        self,
        matches: ClipMatches,
        epoch_ns: int,
        log: GyroLog,
        nothing: Calibration,
        search: tuple[float, float],
        progress: Progress,
    ) -> None:
        self._matches, self._log, self._nothing, self._search, self._progress = matches, log, nothing, search, progress
        self._camera, self._shift = nothing.camera, 1e-9 * (log.epoch_ns - epoch_ns)
        first = float(matches.opens.min()) - search[1] - self._shift
        last = float((matches.opens + matches.durations).max()) - search[0] - self._shift
        if last < log.t[0] or first > log.t[-1]:
            raise ClockError(
                f"the gyro log and the clip are on unrelated clocks: the log spans {log.t[0]:.3f} s to "
                f"{log.t[-1]:.3f} s, the clip with all offsets of the search {first:.3f} s to {last:.3f} s (from "
                f"{log.epoch_ns} ns on); give the start of the clip on the log's clock, or widen the search"
            )
        cut = log.trimmed(first - MARGIN, last + MARGIN)
        self._t, self._omega = cut.t + self._shift, cut.omega
        self._gaps = cut.gaps() + self._shift
        self._tracks = {sign: MeanOrientation(self._t, sign * self._omega) for sign in (1, -1)}

    def _model(self, matches: ClipMatches, mounting: FloatArray) -> ClipModel:
        return ClipModel(matches, self._camera, self._tracks[round(float(np.linalg.det(mounting)))], mounting)

    def _covered(self, offset: float) -> NDArray[np.bool_]:
        """Return the pairs during which the log has samples, shape (pairs,)."""
        start = self._matches.opens[:, 0] - offset - MARGIN
        end = self._matches.opens[:, 1] + self._matches.durations[:, 1] - offset + MARGIN
        covered: NDArray[np.bool_] = (start >= self._t[0]) & (end <= self._t[-1])
        for before, after in self._gaps:
            covered &= (end < before) | (start > after)
        return covered

    def calibration(self) -> Calibration:
        """Search, fit and judge."""
        tried = candidates(self._matches, self._camera, (self._t, self._omega), self._search, CANDIDATES)
        pairs = [int(self._covered(each.offset).sum()) for each in tried]
        tried = [each for each, count in zip(tried, pairs, strict=True) if count >= LEAST_PAIRS]
        if not tried:
            reason = f"the log covers only {max(pairs)} pairs of frames; {LEAST_PAIRS} are needed"
            return replace(self._nothing, reason=reason)
        free = (*OFFSET, *READOUT, *FOCAL, *BIAS)
        few, fits = self._matches.thinned(FEW), []
        for i, (mounting, offset) in enumerate(tried):
            self._progress("search", i / len(tried))
            start, model = self._start()._replace(offset=offset), self._model(few, mounting)
            fits.append(fit_clip(model, start, free, self._covered(offset), rounds=2))
        best, rival, confidence = ranked(tried, fits, few)
        mounting, begin = tried[best].mounting, fits[best].parameters
        explained = _explained(few, fits[best], self._covered(begin.offset))
        name = mounting_name(mounting)
        reason = ""
        if explained < LEAST_EXPLAINED:
            reason = (
                f"the log explains only {max(explained, 0):.0%} of the motion between frames: it belongs to "
                "another clip, the video is stabilised, the scene is near or moves, or the offset is outside the search"
            )
        elif confidence < CONFIDENT:
            reason = (
                f"the clip does not decide between the axes {name} and {mounting_name(tried[rival].mounting)}, the "
                f"latter with a time offset {1e3 * (fits[rival].parameters.offset - begin.offset):+.0f} ms away; turn "
                "the camera about all three axes, unevenly"
            )
        elif np.linalg.det(mounting) < 0:
            reason = left_handed(name)
        found = replace(self._nothing, reason=reason, confidence=confidence, explained=explained, mounting=name)
        return found if reason else self._fitted(found, mounting, begin)

    def _start(self) -> Parameters:
        """Return the start values but for the offset, which the search finds."""
        camera = self._camera
        axis, backwards = divmod(READOUT_DIRECTIONS.index(camera.readout_direction), 2)
        return Parameters(**{READOUT[axis]: -camera.readout_time if backwards else camera.readout_time})

    def _fitted(self, found: Calibration, mounting: FloatArray, begin: Parameters) -> Calibration:
        """Return the calibration by a fit of all parameters, refused if that is not trustworthy."""
        covered = self._covered(begin.offset)
        fit = self._fit(mounting, begin, covered)
        p = fit.parameters
        camera, values, directed = self._values(fit)
        zoom = float(np.exp(p.focal))
        reason = ""
        if _excess(fit, OFFSET) > 1.0:
            reason = "the motion is too small or too even for the clock offset; turn the camera to and fro"
        elif not 0.5 < zoom < 2.0:
            reason = f"the focal length would be {zoom:.2f} times the start value; give a better start value"
        found = replace(
            found,
            reason=reason,
            explained=_explained(self._matches, fit, covered),
            directed=directed,
            pairs=int(fit.used.sum()),
            values=values,
        )
        if reason:
            return found
        log = self._log
        # camera = gyro + offset + drift (camera - middle); the log's clock is changed so that drift is 0.
        middle = 0.5 * float(self._matches.opens.min() + self._matches.opens.max()) - self._shift - p.offset
        log = GyroLog(log.t + p.drift * (log.t - middle), log.omega - (p.bias_x, p.bias_y, p.bias_z), log.epoch_ns)
        turn = [getattr(p, name) for name in TURN]
        if any(abs(angle) > SIGNIFICANT * fit.sd(**{name: 1.0}) for name, angle in zip(TURN, turn, strict=True)):
            mounting = Rotation.from_rotvec(turn).as_matrix() @ mounting
        return replace(found, accepted=True, camera=replace(camera, imu_to_camera=mounting), log=log)

    def _fit(self, mounting: FloatArray, begin: Parameters, covered: NDArray[np.bool_]) -> ClipFit:
        """Fit all parameters, and fix those again that the clip does not determine."""
        model, start = self._model(self._matches, mounting), self._start()
        free = tuple(name for names in LIMITS for name in names)
        fit = fit_clip(model, begin, free, covered)
        p = fit.parameters
        # Rows are read along one axis.
        other = "across" if abs(p.down) / fit.sd(down=1) > abs(p.across) / fit.sd(across=1) else "down"
        fixed = {other: 0.0}
        while True:
            free = tuple(name for name in free if name not in fixed)
            fit = fit_clip(model, fit.parameters._replace(**fixed), free, covered, rounds=3)
            excess = {names: _excess(fit, names) for names in LIMITS if set(names) & set(free)}
            worst = max(excess, key=lambda names: excess[names])
            self._progress("fit", 1.0 - len(excess) / (len(LIMITS) + 1))
            # The offset is the last to be given up: without it, nothing else counts.
            if excess[worst] <= 1.0 or worst == OFFSET:
                return fit
            fixed = {name: getattr(start, name) for name in worst}

    def _values(self, fit: ClipFit) -> tuple[Camera, dict[str, Estimate], bool]:
        """Return the calibrated camera but for its mounting, the numbers, and whether the readout has a direction."""
        p, camera = fit.parameters, self._camera

        def value(number: float, unit: str, **slopes: float) -> Estimate:
            sd = fit.sd(**slopes) if set(slopes) & set(fit.free) else np.nan
            # A number on which no match depends has no deviation.
            return Estimate(number, sd if np.isfinite(sd) else None, unit)

        signed, axis = (p.across, "across") if p.across else (p.down, "down")
        lines = camera.width if axis == "across" else camera.height
        # The fit's offset is that of the middle row; a timestamp marks another one.
        late = (0.5 - TIMESTAMP_SHARES[camera.timestamp_marks]) * (lines - 1) / lines
        offset = p.offset + late * abs(signed)
        zoom = float(np.exp(p.focal))
        fx, fy = (zoom * focal for focal in camera.focal_length)
        readout = value(abs(signed), "s", **{axis: 1.0})
        directed = readout.sd is not None and readout.value > SIGNIFICANT * readout.sd
        values = {
            "time_offset": value(offset, "s", offset=1.0, **{axis: late * float(np.sign(signed))}),
            "focal_length": value(fx, "px", focal=fx),
            "readout_time": readout,
            **{name: value(getattr(p, name), "rad", **{name: 1.0}) for name in TURN},
            **{name: value(getattr(p, name), "rad/s", **{name: 1.0}) for name in BIAS},
            "clock_drift": value(p.drift, "s/s", drift=1.0),
        }
        direction = READOUT_DIRECTIONS[2 * READOUT.index(axis) + (signed < 0)] if directed else camera.readout_direction
        calibrated = replace(
            camera,
            focal_length=(fx, fy),
            readout_time=readout.value,
            readout_sd=0.0,
            readout_direction=direction,
            time_offset=offset,
            time_offset_sd=0.0,
        )
        return calibrated, values, directed


def _explained(matches: ClipMatches, fit: ClipFit, pairs: NDArray[np.bool_]) -> float:
    """Return the share of the energy of the motion of typical points in `pairs` that a fit explains."""
    points = pairs[matches.pair]
    left, whole = (
        np.median((each[points] ** 2).sum(axis=1)) for each in (fit.residuals, matches.moved - matches.points)
    )
    return 1.0 - float(left / max(whole, 1e-12))


def _excess(fit: ClipFit, names: tuple[str, ...]) -> float:
    """Return the largest standard deviation of a group over its limit."""
    limit = LIMITS[names]
    if names == READOUT:
        limit = max(limit, READOUT_SHARE * abs(fit.parameters.down + fit.parameters.across))
    return max(fit.sd(**{name: 1.0}) for name in names) / limit


class Candidate(NamedTuple):
    """A mounting and an offset that may explain the rotation between frames."""

    mounting: FloatArray  # from IMU axes to camera axes; its determinant is -1 for a left-handed log
    offset: float  # camera time minus gyro time, s


def frame_rotations(matches: ClipMatches, camera: Camera) -> FloatArray:
    """Return the camera's rotation vector between the frames of each pair, rad, camera axes, shape (pairs, 3)."""
    rays, ahead = camera.rays(matches.points), camera.rays(matches.moved)
    rotations = np.zeros((len(matches.opens), 3))
    for k, (a, b) in enumerate(pairwise(np.searchsorted(matches.pair, np.arange(len(rotations) + 1)))):
        weights = np.ones(b - a)
        for _ in range(4):
            # The scene turns against the camera.
            rotation, _ = Rotation.align_vectors(rays[a:b], ahead[a:b], weights)
            errors = np.linalg.norm(rays[a:b] - rotation.apply(ahead[a:b]), axis=1)
            weights = 1.0 / (1.0 + (errors / max(np.median(errors), 1e-9)) ** 2)
        rotations[k] = rotation.as_rotvec()
    return rotations


def candidates(
    matches: ClipMatches,
    camera: Camera,  # start values of focal length and lens; its mounting is a candidate too
    log: tuple[FloatArray, FloatArray],  # times (n,) on the matches' clock, s, and rates (n, 3), rad/s, IMU axes
    search: tuple[float, float],  # first and last offset, s
    count: int,
) -> list[Candidate]:
    """Return the mountings and offsets whose rotation between frames agrees best with the seen one, the best first."""
    own = camera.imu_to_camera
    every = np.array([*mountings(), own][: None if mounting_name(own) == OBLIQUE else -1])
    t, omega = log
    angle = cumulative_trapezoid(omega, t, axis=0, initial=0)
    middles = matches.opens + 0.5 * matches.durations
    offsets = np.arange(search[0], search[1] + STEP, STEP)
    turned = np.stack([np.interp(middles - offsets[:, None, None], t, axis) for axis in angle.T], axis=-1)
    interval = np.diff(middles, axis=1)
    gyro = _without_constant_rate(turned[:, :, 1] - turned[:, :, 0], interval)
    seen = _without_constant_rate(frame_rotations(matches, camera), interval)
    # How far typical points move by a rotation about each axis, squared.
    x, y = (camera.rays(matches.points)[:, :2]).T
    reach = np.array([1.0, 1.0, float((x * x + y * y).mean())])
    agreement = np.einsum("i,ki,okj,mij->mo", reach, seen, gyro, every, optimize=True)
    energy = np.einsum("i,okj,mij->mo", reach, gyro**2, every**2, optimize=True)
    # A wrong focal length scales the rotation, which a correlation ignores.
    correlation = agreement / np.sqrt(np.maximum(energy * (reach @ (seen**2).sum(axis=0)), 1e-30))
    found: list[tuple[float, Candidate]] = []
    for mounting, row in zip(every, correlation, strict=True):
        places, _ = find_peaks(np.pad(row, 1, constant_values=-np.inf), distance=max(1, round(SAME / STEP)))
        found += [(float(row[place - 1]), Candidate(mounting, float(offsets[place - 1]))) for place in places]
    found.sort(key=lambda pair: -pair[0])
    return [candidate for _, candidate in found[:count]]


def ranked(tried: Sequence[Candidate], fits: Sequence[ClipFit], matches: ClipMatches) -> tuple[int, int, float]:
    """Return the places of the best fitted candidate and of its best rival, and the confidence of its mounting.

    They are compared by the errors of their points in the `matches` that were fitted, pair by pair. Mountings that
    mirror are for logs with left-handed axes, which are rare: only one that leads counts.
    """
    energy = np.array([(fit.residuals**2).sum(axis=1) for fit in fits])
    scale = np.median(energy, axis=1).min() + 1e-4
    # Log-likelihoods in nats whose tails let wrong points be; all points of a pair together count as one.
    costs = matches.sums(np.log1p(energy / scale).T).T / np.maximum(matches.sums(np.ones(energy.shape[1])), 1.0)
    sums, mirrors = costs.sum(axis=1), np.array([np.linalg.det(each.mounting) < 0 for each in tried])
    best = int(np.argmin(sums + LEAST_LEAD * mirrors))
    others = [i for i in np.argsort(sums).tolist() if i != best and (mirrors[best] or not mirrors[i])]

    def same(i: int) -> bool:
        near = abs(fits[i].parameters.offset - fits[best].parameters.offset) < SAME
        return near and np.array_equal(tried[i].mounting, tried[best].mounting)

    rivals = [i for i in others if not same(i)]
    return best, rivals[0] if rivals else best, confidence(costs[rivals] - costs[best], LEAST_LEAD)


def _without_constant_rate(rotations: FloatArray, interval: FloatArray) -> FloatArray:
    """Return rotations, shape (..., pairs, 3), less the constant rate that fits best: it may be the gyro's bias."""
    rate = (interval * rotations).sum(axis=-2, keepdims=True) / (interval**2).sum()
    changing: FloatArray = rotations - rate * interval
    return changing
