"""What the user probably meant by a time in another unit, or counted from another moment."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.motion.gyro import GyroLog

# Lengths of the log after its end from which a moment is rather in another unit than just missed by the log.
FAR = 10
# s; a shorter exposure time leaves no blur.
LEAST_DURATION = 1e-4


def refuse_longer(duration: float | None, whole: float, path: Path) -> None:
    """Refuse an exposure time that exceeds the file which must cover the exposure."""
    if duration is None or duration <= whole:
        return
    hint = "give a longer recording"
    # A shorter time was hardly meant in another unit: the file is too short.
    if duration >= 1:
        meant = {
            f"{duration:.10g}ms": 1e-3 * duration,
            f"1/{duration:.10g}": 1 / duration,
            f"{duration:.10g}us": 1e-6 * duration,
            f"{1e-9 * duration:.10g} ({duration:.10g} ns)": 1e-9 * duration,
        }
        options = [option for option, seconds in meant.items() if LEAST_DURATION <= seconds <= whole]
        hint = f"did you mean {' or '.join(options)}?" if options else hint
    raise InputError(f"--duration: {duration:g} s is longer than {path} ({whole:.3g} s); {hint}")


def start_hint(start: float, start_ns: int | None, log: GyroLog) -> str:
    """Return a question, after a semicolon, if only another start lies in the log; else nothing.

    Parameters
    ----------
    start : float
        The start in s on the clock of the log, without `start_ns`.
    start_ns : int or None
        The start in ns.
    log : GyroLog
        The log.
    """
    first, last = (log.epoch_ns * 1e-9 + t for t in log.span)
    if start_ns is not None:
        start = 1e-9 * start_ns
        meant = {f"--start-ns {factor * start_ns}": factor * start for factor in (10**3, 10**6, 10**9)}
    else:
        # Digits for microseconds of Unix time, and no more.
        moment = round(first + start, 6)
        meant = {f"--start {moment:.16g}, as the log begins at {round(first, 6):.16g} s": moment}
        if start > last + FAR * (last - first):
            units = {f"--start {start:.10g}ms": 1e-3, f"--start {start:.10g}us": 1e-6, f"--start-ns {start:.0f}": 1e-9}
            meant |= {option: unit * start for option, unit in units.items()}
    option = next((option for option, moment in meant.items() if first <= moment <= last), None)
    return "" if first <= start <= last or option is None else f"; did you mean {option}?"
