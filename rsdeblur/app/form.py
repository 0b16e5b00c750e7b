"""The form of the page as arguments of `rsdeblur deblur`, and arguments as a line for a shell."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rsdeblur.errors import InputError

Form = Mapping[str, Any]

# Options that have a slider; the strengths of the whole picture are derived without them, and so stay while they move.
MOVED = ("time_offset", "readout_time", "focal_length", "softness")
FILES = ("gyro", "camera", "capture")
# Options that the page sets; "more" contains the others.
FIELDS = (*FILES, "index", "start", "start_ns", "duration", "orientation", *MOVED, "mode", "prior")


def filled(options: Mapping[str, str]) -> dict[str, str]:
    """Return the form that means these options and perhaps a photo, given as texts by name."""
    # No field is called "start_ns": the moment that a search found is not typed.
    fields = {name: text for name, text in options.items() if name in ("photo", *FIELDS) and name != "start_ns"}
    others = (word for name, text in options.items() if name not in fields for word in (_flag(name), text))
    return fields | {"more": shlex.join(others)}


def arguments(form: Form, moved: Form | None = None) -> list[str]:
    """Return the arguments of `rsdeblur deblur` that a form means, with automatic strengths.

    Empty texts are left out; `moved` are texts of sliders, which replace those of the form.
    """
    for name, label in (("photo", "photo"), ("gyro", "gyro log")):
        if not text_of(form, name):
            raise InputError(f"choose the {label}")
    words = [path_of(form, "photo")]
    form = {**form, **(moved or {})}
    for name in FIELDS:
        if text_of(form, name):
            words += [_flag(name), path_of(form, name) if name in FILES else text_of(form, name)]
    try:
        return words + shlex.split(text_of(form, "more"))
    except ValueError as error:
        raise InputError(f"other options: {error}") from error


def text_of(form: Form, name: str) -> str:
    """Return a text of a form without spaces around it; empty if it is missing."""
    return str(form.get(name) or "").strip()


def path_of(form: Form, name: str) -> str:
    """Return an absolute path, with which the command works in every folder; empty if it is missing."""
    text = text_of(form, name)
    try:
        return str(Path(text).expanduser().absolute()) if text else ""
    except RuntimeError as error:
        raise InputError(f"{text}: there is no home folder of that name; give the whole path") from error
    except FileNotFoundError as error:
        raise InputError(f"{text}: the folder that the app was started in was deleted; give the whole path") from error


def power_of(form: Form) -> float:
    """Return by how many powers of ten the strength differs from the automatic one."""
    return max(-3.0, min(float(form.get("power", 0.0)), 3.0))


def shell_line(words: Sequence[str]) -> str:
    """Return words as a line that a terminal takes for nothing else: control characters are escaped."""
    return " ".join(map(_quoted, words))


def _quoted(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    # Three octal digits end by themselves, before any character.
    parts = (c if c.isprintable() and c not in "\\'" else "".join(f"\\{b:03o}" for b in os.fsencode(c)) for c in word)
    return f"$'{''.join(parts)}'"


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"
