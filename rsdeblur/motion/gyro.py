"""Gyroscope samples: the recorded rates, in IMU axes and gyro time."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.motion.sensor_log import LARGEST, SensorLog
from rsdeblur.motion.units import SLOWEST
from rsdeblur.types import FloatArray

# rad/s. The range of a consumer gyro ends at 2000 deg/s = 34.9 rad/s, and nobody takes a photo during a sustained turn
# of 5 rad/s (286 deg/s; the fastest pan measured is 3.3 rad/s). A log beyond either is probably in degrees per second.
SUSPICIOUS_PEAK = 35.0
SUSPICIOUS_MEDIAN = 5.0
LARGEST_RATE = LARGEST


@one_line("t", "rate", "span", "epoch_ns")
@dataclass(frozen=True, slots=True, eq=False)
class GyroLog(SensorLog):
    """Angular rates as the gyroscope recorded them.

    Parameters
    ----------
    t : array_like, shape (n,)
        Sample times in s relative to `epoch_ns`, strictly increasing, n >= 2.
    omega : array_like, shape (n, 3)
        Angular rates in rad/s about the IMU's own x, y and z axes, right-handed.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits. It stays an exact integer, because timestamps of 1e18 ns lose
        200 ns in float64.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, a rate is beyond 1e12 rad/s, the times do not increase, or
        `epoch_ns` does not fit into 64 bits.

    Warns
    -----
    RsdeblurWarning
        If the rates look like degrees per second: their median is beyond 5 rad/s, or the largest beyond 35 rad/s; or
        if rates that change have fewer than two samples per second.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log = rsdeblur.GyroLog(np.arange(200) * 0.005, np.full((200, 3), 0.1))
    >>> log.minus_bias([0.1, 0.1, 0.1]).shifted(2.0)
    GyroLog(t=float64[200], rate=200, span=(2, 2.995), epoch_ns=0)
    """

    SENSOR: ClassVar = "gyro"
    UNIT: ClassVar = "rad/s"
    VALUES: ClassVar = "omega"

    t: FloatArray
    omega: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        self._check()
        magnitude = np.sqrt(np.einsum("ij,ij->i", self.omega, self.omega))
        median, peak = float(np.median(magnitude)), float(magnitude.max())
        if median > SUSPICIOUS_MEDIAN or peak > SUSPICIOUS_PEAK:
            warnings.warn(
                f"gyro rates look like degrees per second (median {median:.3g}, peak {peak:.3g}, taken as rad/s); "
                "if they are, multiply by pi/180, or read the log with unit='deg/s' (--unit deg/s)",
                RsdeblurWarning,
                stacklevel=3,
            )
        # A constant rate needs no samples between.
        if self.rate < SLOWEST and np.ptp(self.omega, axis=0).any():
            warnings.warn(
                f"the log has {self.rate:.2g} samples per second; its times must be in s, not ms or ns",
                RsdeblurWarning,
                stacklevel=3,
            )

    def minus_bias(self, b: ArrayLike) -> GyroLog:
        """Return the log with a constant rate subtracted from every sample.

        Parameters
        ----------
        b : array_like, shape (3,)
            Bias in rad/s about the IMU's axes.

        Returns
        -------
        GyroLog

        Raises
        ------
        InputError
            If `b` does not have this shape or is not finite.
        """
        return self._derived(omega=self.omega - validate.real_array("b", b, (3,)))
