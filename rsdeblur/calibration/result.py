"""Result of a calibration, and what clips and photos have in common in judging it."""

from dataclasses import dataclass, field

import numpy as np

from rsdeblur._util.one_line import one_line
from rsdeblur.motion.axes import letters
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray

# Least confidence.
CONFIDENT = 0.95
# Name of a mounting whose axes are not parallel to the camera's.
OBLIQUE = "of the start"


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
    """

    value: float
    sd: float | None
    unit: str

    @property
    def determined(self) -> bool:
        """Whether the clip determines the value."""
        return self.sd is not None


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Result of :func:`rsdeblur.calibrate` and :func:`rsdeblur.calibrate_photos`.

    Parameters
    ----------
    accepted : bool
        Whether the fit is trustworthy.
    reason : str
        Why it is not; empty otherwise.
    camera : Camera
        The calibrated camera; the start's if the fit is refused.
    log : GyroLog or None
        Of a clip: the log without its bias and with its clock's drift undone; the input's if the fit is refused.
    confidence : float, default 0.0
        Share, in [0, 1], of resamplings of the photos, or of the pairs of frames, that give the same mounting.
    mounting : str
        Orientation string of the mounting, like ``"YxZ"``.
    directed : bool
        Whether the direction of the readout is determined; otherwise it is assumed.
    values : dict of str to Estimate
        ``time_offset``, ``focal_length`` and ``readout_time``. Of a clip also ``turn_x``, ``turn_y``, ``turn_z`` (of
        the mounting), ``bias_x``, ``bias_y``, ``bias_z`` and ``clock_drift``. Empty if there was nothing to fit.
    photos : int
        Number of photos; 0 for a clip.
    pairs, matches : int
        Of a clip: number of pairs of frames that were used, and of matches in all pairs.
    explained : float
        Of a clip: share of the energy of the points' motion that the log explains.
    """

    accepted: bool
    reason: str
    camera: Camera
    log: GyroLog | None = None
    confidence: float = 0.0
    mounting: str = ""
    directed: bool = False
    values: dict[str, Estimate] = field(default_factory=dict)
    photos: int = 0
    pairs: int = 0
    matches: int = 0
    explained: float = 0.0


def confidence(leads: FloatArray, least: float) -> float:
    """Return the share of resamplings in which every sum of leads, nats (rivals, observations), exceeds the least."""
    count = leads.shape[1]
    draws = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), 200)
    return float(np.mean((leads @ draws.T).min(axis=0, initial=np.inf) > least))


def mounting_name(mounting: FloatArray) -> str:
    """Return the orientation string of a mounting, or that it is the start's, whose axes are not parallel."""
    return letters(mounting) if np.isin(mounting, (-1.0, 0.0, 1.0)).all() else OBLIQUE


def left_handed(name: str) -> str:
    """Return the reason to refuse a log with left-handed axes."""
    return (
        f"the log has left-handed axes: read it with --orientation {name} (orientation={name!r}), and calibrate again"
    )
