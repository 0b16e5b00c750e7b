"""Sheets of results that differ in the clock, the size of the motion, the readout or a drift."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from click.testing import Result

from rsdeblur.io import read_camera, read_picture

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]


def test_preview_writes_a_sheet_and_the_chosen_offset(run: Run, files: Files, tmp_path: Path) -> None:
    sheet = tmp_path / "sheet.png"
    options = ["--from", "-20ms", "--to", "20ms", "--steps", 3, "--region", "8,4,80,64", "-o", sheet, "--json"]
    listed = json.loads(run("preview", files.photo, *files.recording, *options, "--choose", 3).stdout)
    assert [cell["value"] for cell in listed["cells"]] == pytest.approx([-0.02, 0.0, 0.02])
    assert listed["chosen"]["option"] == "--time-offset 0.02"
    assert read_camera(files.camera).time_offset == pytest.approx(0.02)
    # Three cells, wider than one.
    assert read_picture(sheet).pixels.shape[1] > 480
    result = run("preview", files.photo, *files.recording, "--steps", 2, "-o", sheet, "--force", "--choose", 3)
    assert result.exit_code == 1
    assert "there is no cell 3" in result.stderr
    result = run("preview", files.photo, *files.recording, "--steps", 100_000, "-o", sheet, "--force")
    assert result.exit_code == 2
    assert "--steps" in result.stderr


def test_preview_varies_sizes_and_drifts(run: Run, files: Files, tmp_path: Path) -> None:
    common = [
        "preview",
        files.photo,
        *files.recording,
        "--region",
        "8,4,80,64",
        "-o",
        tmp_path / "sheet.png",
        "--force",
    ]
    listed = json.loads(run(*common, "--vary", "scale", "--from", 0.5, "--to", 2, "--steps", 3, "--json").stdout)
    assert [cell["value"] for cell in listed["cells"]] == pytest.approx([0.5, 1.0, 2.0])
    focal = read_camera(files.camera).focal_length[0]
    assert [cell["option"] for cell in listed["cells"]] == [
        f"--focal-length {factor * focal:g}" for factor in (0.5, 1, 2)
    ]
    before = files.camera.read_text()
    refused = run(*common, "--vary", "drift", "--steps", 8)
    assert refused.exit_code == 2
    assert "like 4 or 9" in refused.stderr
    result = run(*common, "--vary", "drift", "--steps", 4, "--drift", "1,0", "--choose", 2)
    assert "4 of 4 cells, drift -6.0, -6.0 px to +6.0, +6.0 px\ncell 2: --drift 7,-6" in result.stdout
    assert files.camera.read_text() == before
    result = run(*common, "--region", "0,0,1000,1000")
    assert (result.exit_code, "--region: the cut-out 1000x1000" in result.stderr) == (2, True)
    result = run(*common, "--vary", "readout", "--from", 0)
    assert result.exit_code == 2
    assert "--from and --to are factors, which must be positive, got 0 and 2" in result.stderr
