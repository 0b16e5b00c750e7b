"""`rsdeblur batch`: good and bad items, resuming, killed workers, interrupts, clusters, session folders."""

import json
import os
import re
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest

from rsdeblur.choices import VERDICTS
from rsdeblur.cli._items import COLUMNS
from rsdeblur.cli.batch import work
from rsdeblur.io import read_picture

FAST = ("--mode", "global", "--quality", "fast", "--nsr", "0.01", "--jobs", "1")
SOME_FAILED = 3


@pytest.fixture
def manifest(files) -> Path:
    """Three good photos, a missing one and one exposed after the end of the log, as a spreadsheet writes them."""
    folder = files.photo.parent
    shutil.copy(files.photo, folder / "other.png")
    lines = [
        "Photo; capture; index; start; duration; output",
        "photo.png; frames.csv; 0;;;",
        "photo.png; frames.csv; 1;;; second.tif",
        "other.png;; ; 200ms; 1/25;",
        "missing.png; frames.csv; 0;;;",
        "photo.png; frames.csv; 2;;; late.png",
    ]
    (folder / "manifest.csv").write_text("\ufeff" + "\n".join(lines) + "\n", encoding="utf-8")
    return folder / "manifest.csv"


@pytest.fixture
def listed(files):
    """Return a function that writes a manifest of rows `photo,output`, all with one exposure."""

    def write(*rows: str) -> Path:
        path = files.photo.parent / "m.csv"
        path.write_text("photo,output,start,duration\n" + "".join(f"{row},0.2,0.04\n" for row in rows), "utf-8")
        return path

    return write


def entries(run, *arguments: object, code: int = 0) -> list[dict[str, Any]]:
    """Run a batch and return its entry of each item."""
    result = run("batch", *arguments, *FAST, "--json")
    assert result.exit_code == code, result.output
    items: list[dict[str, Any]] = json.loads(result.stdout)["items"]
    return items


def states(items: list[dict[str, Any]]) -> str:
    return " ".join(item["state"] for item in items)


def bits(path: Path) -> bytes:
    """Return the samples of a picture, whose metadata name the options."""
    return read_picture(path).pixels.tobytes()


@pytest.mark.usefixtures("here")
def test_failures_are_listed_and_stop_nothing(run, files, manifest: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("batch", manifest, *files.sources, *FAST, "-o", out)
    assert result.exit_code == SOME_FAILED
    missing, late = result.stderr.splitlines()
    assert "error: " in missing
    assert "missing.png: cannot read the picture" in missing
    assert "does not cover the exposure" in late
    assert re.search(r"^3 done, 2 failed \(.*\); ", result.stdout, re.MULTILINE)
    items = json.loads((out / "batch.json").read_text())["items"]
    assert states(items) == "done done done failed failed"
    assert [item["check"]["verdict"] in VERDICTS for item in items[:3]] == [True] * 3
    written = {path.name for path in out.iterdir()}
    assert written == {"photo.png", "second.tif", "other.png", "batch.json"}
    # An item is what `deblur` makes of the photo.
    assert run("deblur", files.photo, *files.recording, *FAST[:-2], "-o", tmp_path / "one.png").exit_code == 0
    assert bits(out / "other.png") == bits(tmp_path / "one.png")


@pytest.mark.usefixtures("here")
def test_finished_items_are_skipped_and_others_not_replaced(run, files, manifest: Path, tmp_path: Path) -> None:
    out = tmp_path / "manifest-sharp"
    assert f"see {out}" in run("batch", manifest, *files.sources, *FAST).stdout
    shutil.copy(files.photo, tmp_path / "missing.png")
    (out / "other.png").unlink()
    file = (out / "photo.png").stat().st_ino
    call = (manifest, *files.sources)
    assert states(entries(run, *call, code=SOME_FAILED)) == "skipped skipped done done failed"
    assert (out / "photo.png").stat().st_ino == file
    again = entries(run, *call, "--geometry", "rectify", code=SOME_FAILED)
    assert states(again) == "failed failed failed failed failed"
    assert "the file exists; use force (--force)" in again[0]["error"]
    assert states(entries(run, *call, "--force", code=SOME_FAILED)) == "done done done done failed"


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("content", ["[]", '{"items": 3}', "{" * 100_000, ""])
def test_a_list_that_no_batch_wrote_is_another_programs(run, files, listed, tmp_path: Path, content) -> None:
    call, out = (listed("photo.png,a.png"), *files.sources, "-o", tmp_path / "out"), tmp_path / "out"
    entries(run, *call)
    (out / "batch.json").write_text(content)
    result = run("batch", *call, *FAST)
    assert result.exit_code == 1
    assert "the file exists; use force" in result.stderr
    (out / "batch.json").unlink()
    assert states(entries(run, *call, code=SOME_FAILED)) == "failed"


@pytest.mark.usefixtures("here")
def test_after_a_crash_the_results_that_are_there_are_skipped(run, files, listed, tmp_path, monkeypatch) -> None:
    """Nothing is recorded between the start of a batch and its end: a result is written as a whole or not at all."""
    call = (listed("photo.png,a.png", "photo.png,b.png"), *files.sources, "-o", out := tmp_path / "out")
    at_start = {}

    def copy(task: Any) -> Any:
        at_start.setdefault("list", (out / "batch.json").read_bytes())
        return work(task)

    def crash(*options: str) -> None:
        at_start.clear()
        with monkeypatch.context() as patch:
            patch.setattr("rsdeblur.cli.batch.work", copy)
            entries(run, *call, *options)
        (out / "batch.json").write_bytes(at_start["list"])

    crash()
    (out / "b.png").unlink()
    assert states(entries(run, *call)) == "skipped done"
    # While a file is being replaced, the list names no recipe for it, and the old one is not taken for the new one.
    crash("--force", "--border", "periodic")
    assert states(entries(run, *call, "--border", "periodic", code=SOME_FAILED)) == "failed failed"


@pytest.mark.usefixtures("here")
def test_dry_run_writes_nothing(run, files, manifest: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    found = entries(run, manifest, *files.sources, "-o", tmp_path / "out", "--dry-run", code=SOME_FAILED)
    assert states(found) == "checked checked checked failed failed"
    assert found[0]["size_px"] == [96, 72]
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no column photo"),
        (b"photo,foo\na.png,1", "line 1: unknown column 'foo'"),
        (b"index\n1", "line 1: no column photo"),
        (b"photo,start,Start\n", "line 1: the column start occurs 2 times"),
        (b"photo\n", "nothing to do"),
        (b"photo\n\xff.png", "not UTF-8 text"),
    ],
)
def test_bad_manifests(run, tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "m.csv").write_bytes(content)
    result = run("batch", tmp_path / "m.csv", "-o", tmp_path / "out")
    assert (result.exit_code, message in result.stderr) == (1, True)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("here")
def test_bad_rows(run, files, tmp_path: Path) -> None:
    rows = {
        "photo.png,x,1,": "line 2: index: 'x' is not a whole number",
        "photo.png,1,soon,": "line 3: start: 'soon' is not a time",
        ",1,1,": "line 4: no photo",
        "photo.png,1,1": "line 5: 3 cells, but the first line names 4 columns",
        "photo.png,,,": "photo.png: the exposure is missing",
        "photo.png,,0.2,../a.png": "line 7: output: ../a.png leads out of the output folder",
        f"photo.png,,0.2,{tmp_path / 'd.png'}": "leads out of the output folder",
    }
    (tmp_path / "m.csv").write_text("photo,index,start,output\n" + "".join(f"{row}\n" for row in rows))
    found = entries(run, tmp_path / "m.csv", *files.sources, "-o", tmp_path / "out", code=SOME_FAILED)
    assert [text in item["error"] for item, text in zip(found, rows.values(), strict=True)] == [True] * len(rows)
    assert set(COLUMNS) <= set(re.findall(r"\w+", run("batch", "--help").stdout))


@pytest.mark.usefixtures("here")
def test_photos_elsewhere_have_results_in_the_output_folder(run, files, tmp_path: Path) -> None:
    (tmp_path / "lists").mkdir()
    path, out = tmp_path / "lists" / "m.csv", tmp_path / "out"
    path.write_text("photo,start,duration,output\n../photo.png,0.2,0.04,\n../photo.png,0.2,0.04,sub/e.png\n")
    assert states(entries(run, path, *files.sources, "-o", out)) == "done done"
    assert (out / "photo.png").is_file()
    assert (out / "sub" / "e.png").is_file()


@pytest.mark.usefixtures("here")
def test_a_batch_replaces_no_input(run, files, listed, tmp_path: Path) -> None:
    shutil.copy(files.photo, tmp_path / "b.png")
    os.link(files.photo, tmp_path / "c.png")
    path = listed("photo.png,", "b.png,photo.png", "b.png,c.png")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    found = entries(run, path, *files.sources, "--force", "-o", tmp_path, code=SOME_FAILED)
    assert ["is an input too" in item["error"] for item in found] == [True, False, True]
    assert f"photo.png has the same result, {tmp_path / 'photo.png'}" in found[1]["error"]
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    path.rename(tmp_path / "batch.json")
    result = run("batch", tmp_path / "batch.json", *files.sources, *FAST, "--force", "-o", tmp_path)
    assert (result.exit_code, "the result would replace an input" in result.stderr) == (1, True)
    assert (tmp_path / "batch.json").read_bytes() == before["m.csv"]


@pytest.mark.usefixtures("here")
def test_results_that_are_one_file_on_some_disks_clash(run, files, listed, tmp_path: Path) -> None:
    """Windows and macOS ignore case; the first row is done, the second refused."""
    path = listed("photo.png,a.png", "photo.png,A.png")
    found = entries(run, path, *files.sources, *FAST, "-o", tmp_path / "out", code=SOME_FAILED)
    assert states(found) == "done failed"
    assert "has the same result" in found[1]["error"]


def test_a_killed_worker_fails_its_photo_only(processes, files, listed, tmp_path: Path) -> None:
    call = ("batch", listed("photo.png,"), *files.sources, *FAST, "-o", tmp_path / "out")
    with processes.started(*call) as process:
        processes.kill_worker(process)
        stdout, stderr = process.communicate()
    assert (process.returncode, "its process died" in stderr) == (SOME_FAILED, True), stderr
    assert "1 failed" in stdout
    assert {item.name for item in (tmp_path / "out").iterdir()} == {"batch.json"}


def test_interrupt_leaves_nothing_unfinished(run, here: None, processes, files, listed, tmp_path: Path) -> None:
    path, out = listed(*(f"photo.png,{i}.png" for i in range(200))), tmp_path / "out"
    with processes.started("batch", path, *files.sources, *FAST, "-o", out) as process:
        processes.until(process, lambda: len(list(out.glob("*.png"))) > 1)
        os.killpg(process.pid, signal.SIGINT)
        _, stderr = process.communicate()
    assert (process.returncode, stderr) == (130, "rsdeblur: interrupted; no unfinished file is left\n")
    assert {item.name for item in out.iterdir() if item.suffix != ".png"} == {"batch.json"}
    # The finished ones are kept, and the others done.
    finished = len(list(out.glob("*.png")))
    path.write_text("".join(path.read_text().splitlines(keepends=True)[: finished + 3]))
    assert states(entries(run, path, *files.sources, "-o", out)).split() == ["skipped"] * finished + ["done"] * 2
