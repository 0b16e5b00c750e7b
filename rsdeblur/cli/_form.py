"""Forms of the local page: their texts and numbers, and the arguments of `rsdeblur deblur` that they mean."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from rsdeblur.cli._options import Recording
from rsdeblur.errors import InputError

RECORDING = tuple(field.name for field in fields(Recording))
FILES = ("gyro", "camera", "capture")
# Options that have a slider; the strengths of the whole picture are derived without them, and so stay while they move.
MOVED = ("time_offset", "readout_time", "focal_length", "softness")
FORM = (*RECORDING, "mode", "prior", "softness")
# Largest crop, px.
MOST_CROP = 1024
# The slider of the strength spans this many powers of ten to either side of the automatic value.
MOST_POWER = 3.0


def arguments(form: Mapping[str, Any], moved: Mapping[str, Any] | None = None) -> list[str]:
    """Return the arguments of `rsdeblur deblur` that a form means, with automatic strengths.

    Parameters
    ----------
    form : mapping
        Texts by name; empty ones are left out.
    moved : mapping, optional
        Texts of the sliders, which replace those of the form.

    Raises
    ------
    InputError
        If a value is no text, or the photo, the log or the camera is missing.
    """
    for name, label in (("photo", "photo"), ("gyro", "gyro log"), ("camera", "camera file")):
        if not text_of(form, name):
            raise InputError(f"choose the {label}")
    words = [path_of(form, "photo")]
    form = {**form, **(moved or {})}
    for name in FORM:
        if text_of(form, name):
            words += ["--" + name.replace("_", "-"), path_of(form, name) if name in FILES else text_of(form, name)]
    try:
        return words + shlex.split(text_of(form, "more"))
    except ValueError as error:
        raise InputError(f"other options: {error}") from error


def text_of(form: Mapping[str, Any], name: str) -> str:
    """Return a text of a form without spaces around it; empty if it is missing."""
    value = form.get(name)
    if value is not None and not isinstance(value, str):
        raise InputError(f"{name} must be a text, got {value!r}")
    return (value or "").strip()


def path_of(form: Mapping[str, Any], name: str) -> str:
    """Return an absolute path, with which the command works in every folder."""
    text = text_of(form, name)
    return str(Path(text).expanduser().absolute()) if text else ""


def moved_of(form: Mapping[str, Any]) -> dict[str, Any]:
    """Return the texts of the sliders that were moved, by the names of their options."""
    moved = form.get("moved", {})
    if not isinstance(moved, dict) or not moved.keys() <= set(MOVED):
        raise InputError(f"moved must name sliders, got {moved!r}")
    return moved


def power_of(form: Mapping[str, Any]) -> float:
    """Return by how many powers of ten the strength differs from the automatic one."""
    return number_of(form, "power", 0.0, -MOST_POWER, MOST_POWER)


def number_of(form: Mapping[str, Any], name: str, default: float, least: float, most: float) -> float:
    """Return a number of a form that must be between two others; the default if it is missing."""
    value = form.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise InputError(f"{name} must be a number from {least:g} to {most:g}, got {value!r}")
    return float(value)


def box_of(form: Mapping[str, Any]) -> list[int]:
    """Return left, top, width and height of the crop, px."""
    box = form.get("box")
    if not (isinstance(box, list) and len(box) == 4 and all(type(n) is int and n >= 0 for n in box)):
        raise InputError(f"box must be four whole numbers, got {box!r}")
    return [*box[:2], *(min(n, MOST_CROP) for n in box[2:])]
