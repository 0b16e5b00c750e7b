"""Units of logs: their spellings, and what samples say about units that their file does not name."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.types import FloatArray

# Spellings of units, without spaces and in lower case.
TIME_SPELLINGS = {
    "s": "s sec secs second seconds",
    "ms": "ms msec millis millisec milliseconds",
    "us": "us µs μs usec micros microsec microseconds",
    "ns": "ns nsec nanos nanosec nanoseconds",
}
RATE_SPELLINGS = {
    "rad/s": "rad/s rads rads^-1 rads-1 rads⁻¹ rad·s⁻¹ rad*s^-1 rad/sec radians/s radians/sec radianspersecond rad_s "
    "rad_per_s",
    "deg/s": "deg/s degs^-1 degs-1 degs⁻¹ deg/sec °/s °s⁻¹ º/s °/sec dps degrees/s degrees/sec degreespersecond deg_s "
    "deg_per_s",
    "mrad/s": "mrad/s",
    "mdeg/s": "mdeg/s mdps",
}
ACCELERATION_SPELLINGS = {
    "m/s^2": "m/s^2 m/s2 m/s² ms^-2 ms-2 ms⁻² m*s^-2 m/s/s mps2 m_s2 m/sec^2",
    "g": "g",
    "mg": "mg",
}
LENGTH_SPELLINGS = {"m": "m meter meters metre metres"}
UNIT_OF = {
    spelling: unit
    for spellings in (TIME_SPELLINGS, RATE_SPELLINGS, ACCELERATION_SPELLINGS, LENGTH_SPELLINGS)
    for unit, words in spellings.items()
    for spelling in words.split()
}

# Units of time, s.
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Hz. The fastest gyros sample at 8 kHz, the slowest apps of phones twice a second.
SLOWEST, FASTEST = 2.0, 10_000.0
# Seconds from 1970 to 2000 and to 2100; no other clock shows such times at a plausible rate.
SINCE_1970 = (946_684_800.0, 4_102_444_800.0)
# s: nobody records shorter or longer for a photo; devices are switched off more often.
SPANS, LONGEST_UPTIME = (0.1, 7200.0), 3.2e7
# rad/s: the least full scale of a gyro, 250 deg/s.
LEAST_RANGE = 4.3
# s over which gravity's turn is compared with the gyro's, and the turn in rad that shows a wrong unit.
WINDOW, WRONG_TURN = 0.5, 0.2


def dated_unit(timestamps: NDArray[Any], slowest: float = 0.0, fastest: float = FASTEST) -> str | None:
    """Return the unit in which the timestamps are dates since 2000, at a rate (Hz) between these; None if in none."""
    step = spacing_of(timestamps)
    for unit, seconds in SECONDS.items():
        if SINCE_1970[0] <= float(timestamps[0]) * seconds <= SINCE_1970[1]:
            fits = len(timestamps) == 1 or slowest * seconds * step <= 1 <= fastest * seconds * step
            return unit if fits else None
    return None


def spacing_of(timestamps: NDArray[Any]) -> float:
    """Return the mean of ordinary steps: in whole ms, the median of a fast log is off by up to a half."""
    steps = np.abs(np.diff(timestamps).astype(np.float64))
    steps = steps[steps > 0]
    return float(steps[steps <= 3 * np.median(steps)].mean()) if steps.size else 0.0


def units_of_time(timestamps: NDArray[Any], rates: tuple[float, float]) -> list[str]:
    """Return the units that timestamps may be in: the one of dates since 2000, else those that give one of `rates`, Hz.

    Of two, that with a plausible clock and span is returned alone, if there is one.
    """
    if (unit := dated_unit(timestamps, 0.5 * rates[0], rates[1])) is not None:
        return [unit]
    step, first, last = spacing_of(timestamps), float(timestamps[0]), float(timestamps[-1])
    # A small margin for rounding.
    fits = [unit for unit, each in SECONDS.items() if 0.999 / rates[1] <= step * each <= 1.001 / rates[0]]
    for least, most, value in ((0.0, LONGEST_UPTIME, abs(first)), (*SPANS, abs(last - first))):
        likely = [unit for unit in fits if least <= value * SECONDS[unit] <= most]
        fits = likely if len(likely) == 1 else fits
    return fits


def shows_degrees(ns: NDArray[np.int64], rates: FloatArray, forces: FloatArray) -> bool:
    """Whether gravity turns as rates in deg/s say, and not as the same numbers in rad/s.

    `rates` and `forces`, shape (n, 3), are of one table and in the same axes; `forces` may be in any unit.
    """
    t = (ns - ns[:1]).astype(np.float64) * 1e-9
    size = np.linalg.norm(forces, axis=1)
    if len(t) < 3 or not (size > 0).all():
        return False
    step = max(1, round(WINDOW / max(float(np.median(np.diff(t))), 1e-9)))
    starts = np.arange(0, len(t) - step, step)
    if len(starts) < 2:
        return False
    from scipy.spatial.transform import Rotation  # takes 0.25 s to import; few logs need it

    up = forces / size[:, None]
    turns = 0.5 * (rates[1:] + rates[:-1]) * np.clip(np.diff(t), 0, WINDOW)[:, None]
    errors = []
    for factor in (1.0, np.pi / 180):
        direction = up[starts]
        for k in range(step):
            # What is fixed in the world turns against the device.
            direction = Rotation.from_rotvec(-factor * turns[starts + k]).apply(direction)
        cosines = np.einsum("ij,ij->i", direction, up[starts + step])
        errors.append(float(np.median(np.arccos(np.clip(cosines, -1, 1)))))
    return errors[0] > WRONG_TURN and errors[1] < 0.3 * errors[0]


def saturated(rates: FloatArray) -> int:
    """Return the number of samples, shape (n, 3) in rad/s, in runs of equal extremes; 0 if they may be a motion's."""
    size = np.abs(rates)
    extreme = float(size.max(initial=0.0))
    at = size == extreme
    runs = np.zeros(len(rates), bool)
    same = (at[1:] & at[:-1] & (rates[1:] == rates[:-1])).any(axis=1)
    runs[1:] |= same
    runs[:-1] |= same
    count = int(runs.sum())
    is_cut = extreme >= LEAST_RANGE and count > max(3, 0.01 * len(rates)) and np.ptp(rates) > extreme
    return count if is_cut else 0
