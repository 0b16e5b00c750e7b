"""Calibration of camera, clock and IMU from a clip: the motion between its frames against the gyro log.

Karpenko et al. (2011), Jia and Evans (2014), and Forssen and Ringaby (2010) calibrate in this way. Here the search of
clock and mounting comes first, so no start values are needed, and the errors that all points of two frames share have
a variance of their own, so translation of the camera widens the deviations instead of hiding in them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import ReadoutDirection
from rsdeblur.errors import ClockError, InputError
from rsdeblur.estimate.clip_fit import ClipFit, fit_clip
from rsdeblur.estimate.clip_matches import LONGEST_STEP, ClipMatches, match_clip
from rsdeblur.estimate.clip_motion import ClipModel, MeanOrientation, Parameters
from rsdeblur.estimate.mounting import MountingSearch, Ranking, explained_share
from rsdeblur.motion.arguments import exposure_list
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Least number of pairs of frames.
LEAST_PAIRS = 8
# Candidates of mounting and offset that are refined, and matches of a pair that suffice for that.
CANDIDATES, FEW = 8, 20
# Margin of the log around a pair, s, within which the offset may move in the fit.
MARGIN = 0.05

# A parameter counts as determined below this standard deviation; its start value is kept otherwise. rad and rad/s.
LIMITS = {"offset": 3e-3, "focal": 0.03, "turn": 0.0175, "bias": 0.01, "drift": 2e-5}
# For the readout time: the larger of this, s, and of this share of it.
READOUT_LIMIT, READOUT_SHARE = 1e-3, 0.1
# A readout time or a turn nearer to zero than this many standard deviations is zero.
SIGNIFICANT = 3.0
GROUPS = {
    "offset": ("offset",),
    "readout": ("down", "across"),
    "focal": ("focal",),
    "turn": ("turn_x", "turn_y", "turn_z"),
    "bias": ("bias_x", "bias_y", "bias_z"),
    "drift": ("drift",),
}

# Least share of the pairs whose motion fits.
LEAST_USED = 0.5


@dataclass(frozen=True, slots=True)
class Estimate:
    """One calibrated number.

    Parameters
    ----------
    value : float
        The value: the fitted one, or the start value.
    sd : float or None
        Standard deviation; None for a start value.
    unit : str
        Unit of both.

    Raises
    ------
    InputError
        If a number is not finite, `sd` is negative, or `unit` is no text.
    """

    value: float
    sd: float | None
    unit: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", validate.finite("value", self.value))
        if self.sd is not None:
            object.__setattr__(self, "sd", validate.finite("sd", self.sd, minimum=0.0))
        validate.instance("unit", self.unit, str)

    @property
    def determined(self) -> bool:
        """Whether the clip determines the value."""
        return self.sd is not None


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Result of :func:`calibrate`.

    Parameters
    ----------
    accepted : bool
        Whether the fit is trustworthy.
    reason : str
        Why it is not; empty otherwise.
    camera : Camera
        The calibrated camera; the start's if the fit is refused.
    log : GyroLog
        The log without its bias and with its clock's drift undone; the input's if the fit is refused.
    confidence : float
        Share, in [0, 1], of resamplings of the pairs that give the same mounting and offset.
    explained : float
        Share of the energy of the points' motion that the log explains.
    pairs, matches : int
        Number of pairs of frames that were used, and of matches in all pairs.
    mounting : str
        Orientation string of the mounting, like ``"YxZ"``.
    values : dict of str to Estimate
        ``time_offset``, ``focal_length``, ``readout_time`` (negative against the direction of the axis), ``turn_x``,
        ``turn_y``, ``turn_z`` (of the mounting), ``bias_x``, ``bias_y``, ``bias_z`` and ``clock_drift``; empty if there
        was nothing to fit.
    """

    accepted: bool
    reason: str
    camera: Camera
    log: GyroLog
    confidence: float
    explained: float
    pairs: int
    matches: int
    mounting: str
    values: dict[str, Estimate]


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
    """Calibrate from the matches of a clip.

    Parameters
    ----------
    matches : ClipMatches
        The matches, see :func:`rsdeblur.estimate.clip_matches.match_clip`.
    epoch_ns : int
        Origin of their times, ns.
    log, camera, search, progress
        See :func:`calibrate`.
    """
    reason = _too_few(matches)
    if reason:
        return _refused(camera, log, matches, reason)
    return _Clip(matches, epoch_ns, log, camera, search).calibration(progress)


def _too_few(matches: ClipMatches) -> str:
    pairs = len(matches.opens)
    if pairs < LEAST_PAIRS:
        return (
            f"only {pairs} pairs of neighbouring frames show the same things; {LEAST_PAIRS} are needed, at most "
            f"{LONGEST_STEP:g} s apart"
        )
    return ""


def _few_pairs(count: int) -> str:
    return f"the log covers only {count} pairs of frames; {LEAST_PAIRS} are needed"


def _refused(camera: Camera, log: GyroLog, matches: ClipMatches, reason: str) -> Calibration:
    return Calibration(False, reason, camera, log, 0.0, 0.0, len(matches.opens), len(matches.pair), "", {})


class _Clip:
    """The matches with the log on one clock, and the steps from the search to the final fit."""

    def __init__(
        self, matches: ClipMatches, epoch_ns: int, log: GyroLog, camera: Camera, search: tuple[float, float]
    ) -> None:
        self._matches, self._camera, self._log, self._search = matches, camera, log, search
        self._shift = 1e-9 * (log.epoch_ns - epoch_ns)
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
        self._tracks: dict[float, MeanOrientation] = {}

    def _model(self, matches: ClipMatches, mounting: FloatArray) -> ClipModel:
        sign = float(np.sign(np.linalg.det(mounting)))
        if sign not in self._tracks:
            self._tracks[sign] = MeanOrientation(self._t, sign * self._omega)
        return ClipModel(matches, self._camera, self._tracks[sign], mounting)

    def _covered(self, offset: float) -> NDArray[np.bool_]:
        """Return the pairs during which the log has samples, shape (pairs,)."""
        start = self._matches.opens[:, 0] - offset - MARGIN
        end = self._matches.opens[:, 1] + self._matches.durations[:, 1] - offset + MARGIN
        covered: NDArray[np.bool_] = (start >= self._t[0]) & (end <= self._t[-1])
        for before, after in self._gaps:
            covered &= (end < before) | (start > after)
        return covered

    def calibration(self, progress: Progress | None) -> Calibration:
        """Search, fit and judge."""
        ranked = self._ranked(progress)
        if isinstance(ranked, str):
            return _refused(self._camera, self._log, self._matches, ranked)
        covered = self._covered(ranked.fit.parameters.offset)
        reason = ranked.reason
        if covered.sum() < LEAST_PAIRS:
            reason = _few_pairs(covered.sum())
        if reason:
            return replace(
                _refused(self._camera, self._log, self._matches, reason),
                confidence=ranked.confidence,
                explained=ranked.explained,
                mounting=ranked.name,
            )
        fit = self._fit(ranked, covered, progress)
        return self._judged(ranked, fit, covered)

    def _ranked(self, progress: Progress | None) -> Ranking | str:
        """Refine the best candidates of the search with some of the points and compare them, or say what is missing."""
        search = MountingSearch(self._matches, self._camera, self._t, self._omega, self._search)
        own = self._camera.imu_to_camera
        more = () if np.isin(own, (-1.0, 0.0, 1.0)).all() else (own,)
        candidates = search.candidates(CANDIDATES, more)
        covered = [int(self._covered(each.offset).sum()) for each in candidates]
        if max(covered) < LEAST_PAIRS:
            return _few_pairs(max(covered))
        candidates = [each for each, count in zip(candidates, covered, strict=True) if count >= LEAST_PAIRS]
        step = max(1, round(len(self._matches.pair) / len(self._matches.opens) / FEW))
        few = self._matches.selected(np.arange(len(self._matches.pair)) % step == 0)
        fits = []
        for i, candidate in enumerate(candidates):
            start = self._start()._replace(offset=candidate.offset)
            free = tuple(name for group in ("offset", "readout", "focal", "bias") for name in GROUPS[group])
            model = self._model(few, candidate.mounting)
            fits.append(fit_clip(model, start, free, self._covered(candidate.offset), rounds=2))
            if progress:
                progress("search", (i + 1) / len(candidates))
        return Ranking.of(candidates, fits, few)

    def _start(self) -> Parameters:
        """Return the start values but for the offset, which the search finds."""
        camera = self._camera
        signed = camera.readout_time * (-1 if camera.readout_direction in ("bottom-up", "right-left") else 1)
        return Parameters(**{"across" if camera.horizontal_readout else "down": signed})

    def _fit(self, ranked: Ranking, covered: NDArray[np.bool_], progress: Progress | None) -> ClipFit:
        """Fit all parameters, and fix those again that the clip does not determine."""
        model = self._model(self._matches, ranked.best.mounting)
        free = tuple(name for names in GROUPS.values() for name in names)
        fit = fit_clip(model, ranked.fit.parameters, free, covered)
        p = fit.parameters
        # Rows are read along one axis.
        other = "across" if abs(p.down) / fit.sd(down=1) > abs(p.across) / fit.sd(across=1) else "down"
        fixed = {other: 0.0}
        while True:
            free = tuple(name for name in free if name not in fixed)
            fit = fit_clip(model, fit.parameters._replace(**fixed), free, covered, rounds=3)
            excess = {group: _excess(fit, group, names) for group, names in GROUPS.items() if set(names) & set(free)}
            worst = max(excess, key=lambda group: excess[group], default="offset")
            if progress:
                progress("fit", 1.0 - len(excess) / (len(GROUPS) + 1))
            # The offset is the last to be given up: without it, nothing else counts.
            if excess.get(worst, 0.0) <= 1.0 or worst == "offset":
                return fit
            start = self._start()
            fixed = {name: getattr(start, name) for name in GROUPS[worst]}

    def _judged(self, ranked: Ranking, fit: ClipFit, covered: NDArray[np.bool_]) -> Calibration:
        """Return the calibration, refused if the fit is not trustworthy."""
        explained = explained_share(self._matches, fit.residuals, covered)
        camera, values = self._values(ranked, fit)
        zoom = float(np.exp(fit.parameters.focal))
        used = float(fit.used[covered].mean())
        reason = ""
        if used < LEAST_USED:
            reason = f"only {used:.0%} of the pairs of frames agree with each other"
        elif _excess(fit, "offset", GROUPS["offset"]) > 1.0:
            reason = "the motion is too small or too even for the clock offset; turn the camera to and fro"
        elif not 0.5 < zoom < 2.0:
            reason = f"the focal length would be {zoom:.2f} times the start value; give a better start value"
        if not reason:
            t = self._log.t
            p = fit.parameters
            # camera = gyro + offset + drift (camera - middle); the log's clock is changed so that drift is 0.
            middle = 0.5 * float(self._matches.opens.min() + self._matches.opens.max()) - self._shift - p.offset
            log = GyroLog(
                t + p.drift * (t - middle), self._log.omega - (p.bias_x, p.bias_y, p.bias_z), self._log.epoch_ns
            )
        return Calibration(
            accepted=not reason,
            reason=reason,
            camera=self._camera if reason else camera,
            log=self._log if reason else log,
            confidence=ranked.confidence,
            explained=explained,
            pairs=int(fit.used.sum()),
            matches=len(self._matches.pair),
            mounting=ranked.name,
            values=values,
        )

    def _values(self, ranked: Ranking, fit: ClipFit) -> tuple[Camera, dict[str, Estimate]]:
        """Return the calibrated camera, and the numbers with their deviations."""
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
        fx, fy = camera.focal_length
        zoom = float(np.exp(p.focal))
        values = {
            "time_offset": value(offset, "s", offset=1.0, **{axis: late * float(np.sign(signed))}),
            "focal_length": value(fx * zoom, "px", focal=fx * zoom),
            "readout_time": value(abs(signed), "s", **{axis: 1.0}),
            **{name: value(getattr(p, name), "rad", **{name: 1.0}) for name in GROUPS["turn"]},
            **{name: value(getattr(p, name), "rad/s", **{name: 1.0}) for name in GROUPS["bias"]},
            "clock_drift": value(p.drift, "s/s", drift=1.0),
        }
        calibrated = replace(
            camera,
            focal_length=(fx * zoom, fy * zoom),
            readout_time=abs(signed),
            readout_direction=_direction(fit, camera),
            imu_to_camera=_turned(ranked.best.mounting, fit),
            time_offset=offset,
        )
        return calibrated, values


def _direction(fit: ClipFit, camera: Camera) -> ReadoutDirection:
    """Return the direction of the readout; the start's if the readout time is not significant."""
    down, across = (
        getattr(fit.parameters, name) * (abs(getattr(fit.parameters, name)) > SIGNIFICANT * fit.sd(**{name: 1.0}))
        for name in GROUPS["readout"]
    )
    if not set(GROUPS["readout"]) & set(fit.free) or not (down or across):
        return camera.readout_direction
    if across:
        return "left-right" if across > 0 else "right-left"
    return "top-down" if down > 0 else "bottom-up"


def _turned(mounting: FloatArray, fit: ClipFit) -> FloatArray:
    """Return the mounting with the small turn, if that is significant."""
    turn = np.array([getattr(fit.parameters, name) for name in GROUPS["turn"]])
    deviations = np.array([fit.sd(**{name: 1.0}) for name in GROUPS["turn"]])
    if (np.abs(turn) <= SIGNIFICANT * deviations).all():
        return mounting
    turned: FloatArray = Rotation.from_rotvec(turn).as_matrix() @ mounting
    return turned


def _excess(fit: ClipFit, group: str, names: tuple[str, ...]) -> float:
    """Return the largest standard deviation of a group over its limit."""
    if group == "readout":
        limit = max(READOUT_LIMIT, READOUT_SHARE * abs(fit.parameters.down + fit.parameters.across))
    else:
        limit = LIMITS[group]
    return max(fit.sd(**{name: 1.0}) for name in names) / limit
