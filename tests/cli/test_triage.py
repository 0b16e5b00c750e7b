"""`rsdeblur triage`: folders, manifests and clips without a look at their pixels."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import pytest
from click.testing import Result

from tests.installed import needs

if TYPE_CHECKING:
    from conftest import Files

Run = Callable[..., Result]


def test_folder_needs_no_pixels(run: Run, files: Files, tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(3):
        (folder / f"{i}.png").touch()  # empty: whoever reads it fails
    (folder / "cover.png").touch()
    call = ("triage", folder, *files.sources, "--capture", files.captures, "--keep", 2, "-o", tmp_path / "out")
    result = run(*call, "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert [Path(item["photo"]).name for item in report["items"]] == ["0.png", "1.png", "2.png", "cover.png"]
    decisions = [item["decision"] for item in report["items"]]
    assert decisions == ["deblur", "deblur", "unknown", "unknown"]
    assert "does not cover" in report["items"][2]["reason"]
    assert "neither a timestamp nor a frame number" in report["items"][3]["reason"]
    assert report["items"][1]["time_s"] == pytest.approx(0.1)
    assert json.loads((tmp_path / "out" / "triage.json").read_text()) == report
    assert ElementTree.parse(tmp_path / "out" / "triage.svg").getroot().tag.endswith("svg")
    assert "the file exists" in run(*call).stderr
    printed = run(*call, "--force").stdout
    assert "2 deblur, 2 unknown; median" in printed
    assert "the first: " in printed


def test_manifest_and_missing_files(run: Run, files: Files, tmp_path: Path) -> None:
    manifest = tmp_path / "list.csv"
    manifest.write_text("photo,start,duration\nphoto.png,0.2,1ms\nphoto.png,0.2,40ms\n")
    result = run("triage", manifest, *files.sources, "--json")
    # The results of a batch would have the same name; a triage writes none.
    assert [item["decision"] for item in json.loads(result.stdout)["items"]] == ["keep", "deblur"]
    assert run("triage", manifest, *files.sources, "--keep", 3, "--drop", 2).exit_code == 2
    # JSON has no such number.
    assert "inf is not a finite number" in run("triage", manifest, *files.sources, "--drop", "inf").stderr


def test_a_blur_that_is_unknown_everywhere_is_an_error(run: Run, files: Files, tmp_path: Path) -> None:
    """The files are written all the same, as they have all reasons; the message has the first one."""
    manifest, out = tmp_path / "list.csv", tmp_path / "out"
    manifest.write_text("photo,start,duration\na.png,9,40ms\nb.png,8,40ms\n")
    result = run("triage", manifest, *files.sources, "-o", out, "--json")
    assert result.exit_code == 1
    assert f"{manifest}: the blur of all 2 photos is unknown, the first: the gyro log" in result.stderr
    assert json.loads(result.stdout)["counts"]["unknown"] == 2
    assert json.loads((out / "triage.json").read_text()) == json.loads(result.stdout)


OF_PHOTOS = ("--numbered-from", 1), ("--start", "exif")
MOMENTS = ("--start", 2), ("--start-ns", 2)


@pytest.mark.parametrize(("source", "options"), [("clip.mp4", OF_PHOTOS), (".", MOMENTS)])
def test_options_without_effect_are_refused(run: Run, tmp_path: Path, source: str, options: tuple[Any, ...]) -> None:
    (tmp_path / "clip.mp4").touch()
    recording: tuple[str, ...] = ()
    if source == "clip.mp4":
        needs("video")
        recording = "--gyro", "gyro.csv", "--camera", "camera.toml"
    for option in options:
        result = run("triage", tmp_path / source, *recording, *option)
        assert result.exit_code == 2
        assert any(reason in result.stderr for reason in ("is for photos", "is one moment"))
    if source == "clip.mp4":
        assert "--gyro and --camera" in run("triage", tmp_path / source).stderr
