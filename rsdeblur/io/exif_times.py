"""Time of a photo from its EXIF block, on the Unix clock of a log."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from rsdeblur.errors import ClockError, InputError
from rsdeblur.io.exif import Exif
from rsdeblur.motion.gyro import GyroLog

DATE_TIME, SUBSECONDS, OFFSET = 0x9003, 0x9291, 0x9011
GPS_IFD, GPS_TIME, GPS_DATE = 0x8825, 7, 29

SECOND_NS = 10**9
# Time zones differ from UTC by multiples of a quarter of an hour, from -12 to +14 hours.
QUARTER_NS = 900 * SECOND_NS
QUARTERS = range(-48, 57)
# A GPS fix may be older than the photo by this much, ns.
OLDEST_FIX_NS = 300 * SECOND_NS
# Timestamps before the year 2000 are not Unix time: clocks of phones count from their start.
UNIX_SINCE_NS = 946_684_800 * SECOND_NS
# Years of photos: cameras whose clock is not set write the year 0 or 1, and 64 bits of ns end in 2262.
YEARS = range(1900, 2262)
# Time in EXIF minus the start of the exposure, s: cameras write the command, the end or the storing of the picture, and
# some whole seconds only.
EXIF_ERROR = (-2.0, 1.0)


class CaptureTime(NamedTuple):
    """Time of a photo: Unix time, or its local time as if that were UTC, in ns."""

    ns: int
    has_zone: bool


def capture_time(exif: Exif) -> CaptureTime:
    """Return the time at which a photo was taken: DateTimeOriginal, its fraction, and its offset or that of the GPS."""
    try:
        local = datetime.strptime(_text(exif, DATE_TIME), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        if local.year not in YEARS:
            raise ValueError
    except ValueError:
        raise InputError("the EXIF block contains no DateTimeOriginal; give --start or --start-ns") from None
    digits = _text(exif, SUBSECONDS)
    fraction = int(digits[:9].ljust(9, "0")) if digits.isascii() and digits.isdigit() else 0
    ns = round(local.timestamp()) * SECOND_NS + fraction
    with suppress(ValueError):
        zone = datetime.strptime(_text(exif, OFFSET), "%z").utcoffset()
        return CaptureTime(ns - round((zone or timedelta()).total_seconds()) * SECOND_NS, True)
    fix = _gps_time(exif)
    if fix is not None:
        quarters = round((ns - fix) / QUARTER_NS)
        if quarters in QUARTERS and abs(ns - quarters * QUARTER_NS - fix) < OLDEST_FIX_NS:
            return CaptureTime(ns - quarters * QUARTER_NS, True)
    return CaptureTime(ns, False)


def shown_time(exif: Exif) -> str | None:
    """Return the time at which a photo was taken, as text; None if the block has none."""
    try:
        time = capture_time(exif)
    except InputError:
        return None
    return f"{_shown(time.ns)}.{time.ns // 1_000_000 % 1000:03d} {'UTC' if time.has_zone else 'local time'}"


def on_clock_of(time: CaptureTime, log: GyroLog) -> int:
    """Return the Unix time of a photo in ns; without a time zone, in the one zone in which the log covers the photo."""
    first, last = (log.epoch_ns + round(end * SECOND_NS) for end in log.span)
    if first < UNIX_SINCE_NS:
        raise ClockError("the timestamps of the log are not Unix time, so the time in EXIF has no place on its clock")
    zones = [quarter * QUARTER_NS for quarter in QUARTERS] if not time.has_zone else [0]
    early, late = (round(error * SECOND_NS) for error in EXIF_ERROR)
    fitting = [time.ns - zone for zone in zones if first + early <= time.ns - zone <= last + late]
    if len(fitting) != 1:
        what = "several time zones fit" if fitting else "the log does not cover it"
        zone = "" if time.has_zone else ", local time"
        raise ClockError(
            f"the photo was taken at {_shown(time.ns)}{zone} by its EXIF block, the log spans {_shown(first)} to "
            f"{_shown(last)} UTC: {what}; give --start-ns"
        )
    return fitting[0]


def _text(exif: Exif, tag: int) -> str:
    value = exif.camera.get(tag)
    return value.replace("\0", "").strip() if isinstance(value, str) else ""


def _gps_time(exif: Exif) -> int | None:
    """Return the UTC time of the GPS fix in ns."""
    with suppress(ValueError, TypeError, ArithmeticError, LookupError, AttributeError):
        gps = exif.main.get_ifd(GPS_IFD)
        day = datetime.strptime(gps[GPS_DATE].replace("\0", "").strip(), "%Y:%m:%d").replace(tzinfo=UTC)
        hours, minutes, seconds = map(float, gps[GPS_TIME])
        return round(day.timestamp() + 3600 * hours + 60 * minutes + seconds) * SECOND_NS
    return None


def _shown(ns: int) -> str:
    return datetime.fromtimestamp(ns // SECOND_NS, UTC).strftime("%Y-%m-%d %H:%M:%S")
