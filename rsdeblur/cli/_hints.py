"""What the user probably meant by a time in another unit, or counted from another moment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.motion.gyro import GyroLog

# Lengths of the log after its end from which a moment is rather in another unit than just missed by the log.
FAR = 10


def refuse_longer(duration: float | None, whole: float, path: Path) -> None:
    """Refuse an exposure time that exceeds the file which must cover the exposure."""
    if duration is None or duration <= whole:
        return
    # A shorter time was hardly meant in another unit: the file is too short.
    hint = f"did you mean {duration:g}ms or 1/{duration:g}?" if duration >= 1 else "give a longer recording"
    raise InputError(f"--duration: {duration:g} s is longer than {path} ({whole:.3g} s); {hint}")


def start_hint(start: float, log: GyroLog) -> str:
    """Return a question, after a semicolon, if only another start than `start` (s) lies in the log; else nothing."""
    first, last = (log.epoch_ns * 1e-9 + t for t in log.span)
    meant = {f"--start {first + start:.10g}, as the log begins at {first:.10g} s": first + start}
    if start > last + FAR * (last - first):
        units = {f"--start {start:.10g}ms": 1e-3, f"--start {start:.10g}us": 1e-6, f"--start-ns {start:.0f}": 1e-9}
        meant |= {option: unit * start for option, unit in units.items()}
    option = next((option for option, moment in meant.items() if first <= moment <= last), None)
    return "" if first <= start <= last or option is None else f"; did you mean {option}?"
