"""Times of photos on the clock of a log, by the time of day."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import NamedTuple

from rsdeblur.errors import ClockError
from rsdeblur.motion.gyro import GyroLog

SECOND_NS = 10**9
# Time in EXIF minus the start of the exposure, s: cameras write the command, the end or the storing of the picture, and
# some whole seconds only.
EXIF_ERROR = (-2.0, 1.0)


class CaptureTime(NamedTuple):
    """Time of a photo: Unix time, or its local time as if that were UTC, in ns."""

    ns: int
    has_zone: bool


def on_clock_of(time: CaptureTime, log: GyroLog) -> int:
    """Return the Unix time of a photo in ns; without a time zone, in the one zone in which the log covers the photo."""
    first, last = (log.epoch_ns + round(end * SECOND_NS) for end in log.span)
    # Timestamps before the year 2000 are not Unix time: clocks of phones count from their start.
    if first < 946_684_800 * SECOND_NS:
        raise ClockError("the timestamps of the log are not Unix time, so the time in EXIF has no place on its clock")
    early, late = (round(error * SECOND_NS) for error in EXIF_ERROR)
    # Time zones differ from UTC by multiples of a quarter of an hour, from -12 to +14 hours.
    quarters = range(1) if time.has_zone else range(-48, 57)
    times = [time.ns - quarter * 900 * SECOND_NS for quarter in quarters]
    fitting = [ns for ns in times if first + early <= ns <= last + late]
    if len(fitting) != 1:
        what = "several time zones fit" if fitting else "the log does not cover it"
        zone = "" if time.has_zone else ", local time"
        raise ClockError(
            f"the photo was taken at {shown(time.ns)}{zone} by its EXIF block, the log spans {shown(first)} to "
            f"{shown(last)} UTC: {what}; give --start-ns"
        )
    return fitting[0]


def shown(ns: int) -> str:
    """Return a Unix time in ns as text, UTC."""
    return datetime.fromtimestamp(ns // SECOND_NS, UTC).strftime("%Y-%m-%d %H:%M:%S")
