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

from rsdeblur import Correction, Exposure, Refinement, read_camera, read_gyro
from rsdeblur.cli._refinement import correction_text, refinement_facts

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
    found = Refinement(*given, False, "it is right", Correction(), Correction(), 0.0, 0.0)
    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", lambda *_, **__: found)
    call = "deblur", files.photo, *files.recording, "--force", *options, "-o", tmp_path / "sharp.png"
    facts = json.loads(run(*call, "--json").stdout)
    assert (facts["refinement"] is not None) == refined
    # Why a recording stays as it is interests who asked for more.
    assert ("it is right" in run(*call).stdout) == ("--refine" in options)
    assert ("it is right" in run(*call, "--verbose").stdout) == refined


def test_only_changed_numbers_are_named(files: Files) -> None:
    given = read_gyro(files.gyro), read_camera(files.camera), Exposure(0.2, 0.04), None
    found = Refinement(*given, True, "", Correction(drift_y=-1.5, offset=2e-3), Correction(), 40.0, 0.05)
    text = correction_text(refinement_facts(found))
    assert text == "Recording corrected: drift +0.0 and -1.5 px, time offset +2.0 ms."
    text = correction_text(refinement_facts(replace(found, regions=np.array([[0.5, 1.0], [1.0, 2.0]]))))
    assert "drift +0.0 and -1.5 px (x 0.5 to 2 by region), time" in text
