"""The commands' correction of the recording by the picture."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur import Correction, Exposure, read_camera, read_gyro
from rsdeblur.estimate import Refinement
from rsdeblur.motion.axes import imu_to_camera

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]


@pytest.mark.parametrize(
    ("options", "refined"),
    [
        ((), True),
        (("--no-refine",), False),
        (("--quality", "fast"), False),
        (("--quality", "fast", "--refine"), True),
        (("--max-memory", "1GiB"), False),
    ],
)
def test_recordings_are_refined_unless_that_is_slow_or_impossible(
    run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], refined: bool
) -> None:
    log, camera = read_gyro(files.gyro), read_camera(files.camera)
    given = log, camera, Exposure(0.2, 0.04), None
    found = Refinement(*given, False, "it is right", Correction(), Correction(), 0.0, 0.0, 0.0)
    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", lambda *_, **__: found)
    call = "deblur", files.photo, *files.recording, "--force", *options, "-o", tmp_path / "sharp.png"
    facts = json.loads(run(*call, "--json").stdout)
    assert (facts["refinement"] is not None) == refined
    # Why a recording stays as it is interests who asked for more.
    assert ("it is right" in run(*call).stdout) == ("--refine" in options)
    assert ("it is right" in run(*call, "--verbose").stdout) == refined


@pytest.mark.parametrize(
    ("orientation", "preset", "side"),
    [
        (1, "phone-portrait", None),
        (1, "phone-landscape", "right"),
        (1, "phone-landscape-reversed", "left"),
        (1, "phone-portrait-reversed", "top"),
        (6, "phone-landscape", None),
        (6, "phone-portrait", "left"),
        (8, "phone-landscape-reversed", None),
        (3, "phone-portrait-reversed", None),
        (5, "phone-portrait", None),  # mirrored: nothing is known
    ],
)
def test_gravity_names_wrong_axes_which_are_not_refined(
    run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, orientation: int, preset: str, side: str
) -> None:
    t, *rates = files.samples().T
    force = np.broadcast_to([0.0, 9.8, 0.5], (len(t), 3))  # a phone held upright
    header = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ax[m/s^2], ay[m/s^2], az[m/s^2]"
    table = np.column_stack([np.round(t * 1e9), *rates, force])
    np.savetxt(files.gyro, table, ["%d", *["%.6f"] * 6], ", ", header=header, comments="")
    replace(read_camera(files.camera), imu_to_camera=imu_to_camera(preset)).save(files.camera)
    exif = Image.Exif()
    exif[0x0112] = orientation
    with Image.open(files.photo) as picture:
        picture.save(files.photo, exif=exif)
    calls = []

    def refine(*_: object, known_axes: bool, **__: object) -> Refinement:
        calls.append(known_axes)
        return found

    given = read_gyro(files.gyro), read_camera(files.camera), Exposure(0.2, 0.04), None
    found = Refinement(*given, False, "it is right", Correction(), Correction(), 0.0, 0.0, 0.0)
    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", refine)
    call = "deblur", files.photo, *files.recording, "--force", "-o", tmp_path / "sharp.png"
    said = run(*call).stderr
    assert ("gravity points" in said) == (side is not None)
    if side is not None:
        fits = {1: "phone-portrait", 6: "phone-landscape"}[orientation]
        assert f"points to the {side} of" in said
        # "gyroflow" fits like "phone-landscape", but is for other logs.
        assert f"wrong ({fits} fits)" in said
    # Other axes are only tried where gravity says nothing.
    known = orientation != 5
    assert calls == ([] if side else [known])
    run(*call, "--refine")
    assert calls == ([False] if side else [known, known])
    # `compare` sees, says and refines the same.
    compared = run("compare", *call[1:-2], "--mode", "banded", "--refine", "-o", tmp_path / "compared")
    assert compared.stderr == said
    assert calls[-1] == (known and side is None)
    assert "Recording not corrected: it is right." in compared.stdout
    (entry,) = json.loads(run("info", *files.sources, "--capture", files.captures, "--json").stdout)
    angle = {"phone-portrait": 0, "phone-landscape": 90, "phone-landscape-reversed": -90}.get(preset)
    assert angle in (entry["exposures"][0]["gravity_deg"], None)
