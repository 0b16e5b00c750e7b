"""Samples of an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rsdeblur._util.one_line import one_line
from rsdeblur.motion.sensor_log import SensorLog
from rsdeblur.types import FloatArray

# m/s^2. No accelerometer gives larger numbers, whatever the unit.
LARGEST_FORCE = 1e12


@one_line("t", "rate", "span", "epoch_ns")
@dataclass(frozen=True, slots=True, eq=False)
class AccelerationLog(SensorLog):
    """Specific forces as the accelerometer recorded them: its acceleration minus that of gravity.

    At rest, an accelerometer shows 9.8 m/s^2 upwards.

    Parameters
    ----------
    t : array_like, shape (n,)
        Sample times in s relative to `epoch_ns`, strictly increasing, n >= 2, on the gyro's clock.
    force : array_like, shape (n, 3)
        Specific forces in m/s^2 along the IMU's x, y and z axes, which are those of the gyro log.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, a force is beyond 1e12 m/s^2, the times do not increase,
        or `epoch_ns` does not fit into 64 bits.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.AccelerationLog([0.0, 0.01, 0.02], [[0, 0, 9.81]] * 3)
    AccelerationLog(t=[0, 0.01, 0.02], rate=100, span=(0, 0.02), epoch_ns=0)
    """

    SENSOR: ClassVar = "accelerometer"
    UNIT: ClassVar = "m/s^2"
    VALUES: ClassVar = "force"
    LARGEST: ClassVar = LARGEST_FORCE

    t: FloatArray
    force: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        self._check()
