"""`rsdeblur batch`: good and bad items, resuming, killed workers, interrupts, clusters, session folders."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import Result
from PIL import Image

from rsdeblur.choices import VERDICTS
from rsdeblur.cli._items import COLUMNS
from rsdeblur.cli._output import SOME_FAILED
from rsdeblur.cli.batch import work
from rsdeblur.io import read_picture
from tests.installed import needs

if TYPE_CHECKING:
    from conftest import Files, Processes

    Run = Callable[..., Result]

FAST = ("--mode", "global", "--quality", "fast", "--nsr", "0.01", "--jobs", "1")


def bits(path: Path) -> bytes:
    """Return the samples of a picture, whose metadata name the options."""
    return read_picture(path).pixels.tobytes()


@pytest.fixture
def manifest(files: Files) -> Path:
    """Three good photos, a missing one and one exposed after the end of the log, as a spreadsheet writes them."""
    folder = files.photo.parent
    shutil.copy(files.photo, folder / "other.png")
    path = folder / "manifest.csv"
    lines = [
        "Photo; capture; index; start; duration; output",
        "photo.png; frames.csv; 0;;;",
        "photo.png; frames.csv; 1;;; second.tif",
        "other.png;; ; 200ms; 1/25;",
        "missing.png; frames.csv; 0;;;",
        "photo.png; frames.csv; 2;;; late.png",
    ]
    path.write_text("\ufeff" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def entries(run: Run, *arguments: object, code: int = 0) -> list[dict[str, Any]]:
    """Run a batch and return its entry of each item."""
    result = run("batch", *arguments, *FAST, "--json")
    assert result.exit_code == code, result.output
    items: list[dict[str, Any]] = json.loads(result.stdout)["items"]
    return items


def states(items: list[dict[str, Any]]) -> str:
    return " ".join(item["state"] for item in items)


@pytest.mark.usefixtures("here")
def test_failures_are_listed_and_stop_nothing(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("batch", manifest, *files.sources, *FAST, "-o", out)
    assert result.exit_code == SOME_FAILED
    errors = result.stderr.splitlines()
    assert [line.startswith("rsdeblur: error: ") for line in errors] == [True, True]
    assert "missing.png: cannot read the picture" in errors[0]
    assert "does not cover the exposure" in errors[1]
    assert "3 done, 2 failed" in result.stdout
    with open(out / "batch.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["state"] for row in table] == ["done", "done", "done", "failed", "failed"]
    assert [row["verdict"] in VERDICTS for row in table] == [True] * 3 + [False] * 2
    assert [row["state"] for row in table] == states(json.loads((out / "batch.json").read_text())["items"]).split()
    assert {path.name for path in out.iterdir() if path.suffix in (".png", ".tif")} == {
        "photo.png",
        "second.tif",
        "other.png",
    }


@pytest.mark.usefixtures("here")
def test_an_item_equals_the_result_of_deblur(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    assert f"see {tmp_path / 'manifest-sharp'}" in run("batch", manifest, *files.sources, *FAST).stdout
    one = run("deblur", files.photo, *files.recording, *FAST[:-2], "-o", tmp_path / "one.png")
    assert one.exit_code == 0
    assert bits(tmp_path / "manifest-sharp" / "other.png") == bits(tmp_path / "one.png")


@pytest.mark.usefixtures("here")
def test_finished_items_are_skipped(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    call = (manifest, *files.sources, "-o", out)
    entries(run, *call, code=SOME_FAILED)
    shutil.copy(files.photo, tmp_path / "missing.png")
    (out / "other.png").unlink()
    file = (out / "photo.png").stat().st_ino
    assert states(entries(run, *call, code=SOME_FAILED)) == "skipped skipped done done failed"
    assert (out / "photo.png").stat().st_ino == file
    assert states(entries(run, *call, "--force", code=SOME_FAILED)) == "done done done done failed"


@pytest.mark.usefixtures("here")
def test_items_that_failed_leave_no_empty_folders(run: Run, files: Files, tmp_path: Path) -> None:
    out, path = tmp_path / "out", tmp_path / "m.csv"
    # Beyond the log, which shows before the work, and a size that is not the camera's, which shows in it.
    Image.new("RGB", (80, 72)).save(tmp_path / "small.png")
    rows = ["photo.png,9,a/b/late.png", "small.png,0.2,c/small.png", "photo.png,9,d/late.png", "photo.png,0.2,d/p.png"]
    path.write_text("photo,start,output,duration\n" + "".join(f"{row},0.04\n" for row in rows))
    (out / "mine").mkdir(parents=True)
    found = entries(run, path, *files.sources, "-o", out, code=SOME_FAILED)
    assert states(found) == "failed failed failed done"
    assert {item.name for item in out.iterdir() if item.is_dir()} == {"mine", "d"}


@pytest.mark.usefixtures("here")
def test_results_of_other_settings_are_not_replaced(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    call = (manifest, *files.sources, "-o", tmp_path / "out")
    entries(run, *call, code=SOME_FAILED)
    again = entries(run, *call, "--geometry", "rectify", code=SOME_FAILED)
    assert states(again[:3]) == "failed failed failed"
    assert "the file exists; use force (--force)" in again[0]["error"]


@pytest.mark.usefixtures("here")
def test_without_its_list_results_are_those_of_another_program(
    run: Run, files: Files, manifest: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    call = (manifest, *files.sources, "-o", out)
    entries(run, *call, code=SOME_FAILED)
    content = (out / "batch.json").read_text()
    # Not as it was written: it could claim anything.
    (out / "batch.json").write_text(content.replace('"done"', '"skipped"', 1))
    result = run("batch", *call, *FAST)
    assert result.exit_code == 1
    assert "the file exists; use force (--force)" in result.stderr
    for name in ("batch.csv", "batch.json"):
        (out / name).unlink()
    assert states(entries(run, *call, code=SOME_FAILED)[:3]) == "failed failed failed"


@pytest.mark.usefixtures("here")
def test_after_a_crash_the_results_that_are_there_are_skipped(
    run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is recorded between the start of a batch and its end: a result is written as a whole or not at all."""
    (tmp_path / "m.csv").write_text(
        "photo,output,start,duration\n" + "".join(f"photo.png,{i}.png,0.2,0.04\n" for i in "ab")
    )
    call = (tmp_path / "m.csv", *files.sources, "-o", out := tmp_path / "out")
    at_start = {}

    def copy(task: Any) -> Any:
        at_start.setdefault("list", (out / "batch.json").read_bytes())
        return work(task)

    with monkeypatch.context() as patch:
        patch.setattr("rsdeblur.cli.batch.work", copy)
        entries(run, *call)
    (out / "batch.json").write_bytes(at_start["list"])
    (out / "b.png").unlink()
    assert states(entries(run, *call)) == "skipped done"
    # While a file is being replaced, the list names no recipe for it, and the old one is not taken for the new one.
    at_start.clear()
    with monkeypatch.context() as patch:
        patch.setattr("rsdeblur.cli.batch.work", copy)
        entries(run, *call, "--force", "--border", "periodic")
    (out / "batch.json").write_bytes(at_start["list"])
    assert states(entries(run, *call, "--border", "periodic", code=SOME_FAILED)) == "failed failed"


@pytest.mark.usefixtures("here")
def test_a_run_without_any_result_leaves_the_table_of_earlier_ones(run: Run, files: Files, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("photo,start,duration\nphoto.png,0.2,0.04\n")
    call = ("batch", tmp_path / "m.csv", *files.sources, *FAST, "-o", out := tmp_path / "out")
    assert run(*call).exit_code == 0
    before = [(out / name).read_bytes() for name in ("batch.csv", "batch.json")]
    result = run(*call, "--border", "periodic")
    assert "made with other options" in result.stderr
    assert "batch.csv and batch.json: left as they are" in result.stderr
    assert [(out / name).read_bytes() for name in ("batch.csv", "batch.json")] == before


@pytest.mark.usefixtures("here")
def test_dry_run_writes_nothing(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    found = entries(run, manifest, *files.sources, "-o", tmp_path / "out", "--dry-run", code=SOME_FAILED)
    assert states(found) == "checked checked checked failed failed"
    assert found[0]["size_px"] == [96, 72]
    result = run("deblur", files.photo, *files.recording, "-o", tmp_path / "one.png", "--dry-run")
    assert result.exit_code == 0
    assert f"would write {tmp_path / 'one.png'}" in result.stdout
    result = run("deblur", files.photo, *files.sources, "--start", "9", "--duration", "1", "-o", "x.png", "--dry-run")
    assert result.exit_code == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("", "manifest is empty"),
        ("photo,foo\na.png,1", "line 1: unknown column 'foo'"),
        ("index\n1", "line 1: no column photo"),
        ("photo,start,Start\n", "line 1: the column start occurs 2 times"),
        ("photo\n", "nothing to do"),
        (b"photo\n\xff.png", "not UTF-8 text"),
    ],
)
def test_bad_manifests(run: Run, tmp_path: Path, lines: str | bytes, message: str) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(lines if isinstance(lines, bytes) else lines.encode())
    result = run("batch", path, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("photo.png,x,1", "line 2: index: 'x' is not a whole number"),
        ("photo.png,1,soon", "line 2: start: 'soon' is not a time"),
        (",1,1", "line 2: no photo"),
        ("photo.png,1", "line 2: 2 cells, but the first line names 3 columns"),
        ("photo.png,,", "photo.png: the exposure is missing"),
    ],
)
@pytest.mark.usefixtures("here")
def test_bad_rows(run: Run, files: Files, tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / "m.csv"
    path.write_text(f"photo,index,start\n{row}\n")
    (item,) = entries(run, path, *files.sources, "-o", tmp_path / "out", code=SOME_FAILED)
    assert message in item["error"]


def test_the_help_names_every_column(run: Run) -> None:
    assert set(COLUMNS) <= set(re.findall(r"\w+", run("batch", "--help").stdout))


@pytest.mark.usefixtures("here")
def test_nothing_is_written_outside_the_output_folder(run: Run, files: Files, tmp_path: Path) -> None:
    folder = tmp_path / "lists"
    folder.mkdir()
    path = folder / "m.csv"
    outside = ["../a.png", "..", "b/../../c.png", str(tmp_path / "d.png")]
    rows = "".join(f"../photo.png,0.2,0.04,{output}\n" for output in [*outside, "", "sub/e.png"])
    path.write_text(f"photo,start,duration,output\n{rows}")
    before = set(tmp_path.rglob("*"))
    found = entries(run, path, *files.sources, "-o", tmp_path / "out", code=SOME_FAILED)
    assert states(found) == "failed failed failed failed done done"
    assert "line 2: output: ../a.png leads out of the output folder" in found[0]["error"]
    out = tmp_path / "out"
    written = set(tmp_path.rglob("*")) - before
    assert all(path == out or out in path.parents for path in written)
    assert (out / "photo.png").is_file()
    assert (out / "sub" / "e.png").is_file()


def test_a_killed_worker_is_replaced(processes: Processes, files: Files, tmp_path: Path) -> None:
    out = tmp_path / "out"
    path = tmp_path / "m.csv"
    path.write_text("photo,start,duration\nphoto.png,0.2,0.04\n")
    with processes.started("batch", path, *files.sources, *FAST, "-o", out) as process:
        processes.kill_worker(process)
        stdout, stderr = process.communicate()
    assert process.returncode == 0, stderr
    assert "1 done" in stdout
    assert sorted(item.name for item in out.iterdir()) == ["batch.csv", "batch.json", "photo.png"]


def test_interrupt_leaves_nothing_unfinished(
    run: Run, here: None, processes: Processes, files: Files, tmp_path: Path
) -> None:
    out, path = tmp_path / "out", tmp_path / "m.csv"
    path.write_text("photo,start,duration,output\n" + "".join(f"photo.png,0.2,0.04,{i}.png\n" for i in range(200)))
    with processes.started("batch", path, *files.sources, *FAST, "-o", out) as process:
        processes.until(process, lambda: len(list(out.glob("*.png"))) > 1)
        os.killpg(process.pid, signal.SIGINT)
        _, stderr = process.communicate()
    assert process.returncode == 130
    assert stderr == "rsdeblur: interrupted; no unfinished file is left\n"
    assert {item.name for item in out.iterdir() if item.suffix != ".png"} == {"batch.csv", "batch.json"}
    # The finished ones are kept, and the others done.
    finished = len(list(out.glob("*.png")))
    path.write_text("".join(path.read_text().splitlines(keepends=True)[: finished + 3]))
    again = states(entries(run, path, *files.sources, "-o", out)).split()
    assert again == ["skipped"] * finished + ["done"] * 2


def test_the_page_shows_every_photo_the_most_doubtful_first(
    run: Run, here: None, files: Files, manifest: Path, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    result = run("batch", manifest, *files.sources, *FAST, "-o", tmp_path / "out", "--report", page)
    assert re.search(r"^3 done, 2 failed \(.*\); ", result.stdout, re.MULTILINE)
    text = page.read_text("utf-8")
    assert text.count("<figure>") == 5
    assert text.index("failed</span>") < text.rindex("<figure>")
    # Every photo that can be read, and every result.
    assert text.count("data:image/jpeg") >= 6
    assert str(tmp_path) not in re.sub(r"<figcaption>.*?</figcaption>", "", text)


def test_on_a_cluster(run: Run, files: Files, manifest: Path, tmp_path: Path) -> None:
    distributed = needs("dask")
    with distributed.LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        call = (manifest, *files.sources, "-o", tmp_path / "out", "--scheduler", cluster.scheduler_address)
        assert states(entries(run, *call, code=SOME_FAILED)) == "done done done failed failed"
    for address in ("nonsense://x", "tls://127.0.0.1:9"):
        result = run("batch", manifest, *files.sources, "-o", tmp_path / "new", "--scheduler", address)
        assert result.exit_code == 1
        assert f"no Dask scheduler answers at {address}" in result.stderr


@pytest.mark.usefixtures("here")
def test_mars_session(run: Run, files: Files, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    (folder / "frames").mkdir(parents=True)
    since = 10**12
    lines = [f"{round(1e9 * s[0]) + since},{s[1]},{s[2]},{s[3]},0,0,9.8" for s in files.samples()]
    head = "Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s],ax[m/s^2],ay[m/s^2],az[m/s^2]"
    (folder / "gyro_accel.csv").write_text("\n".join([head, *lines]) + "\n")
    captures = [line.split(",") for line in files.captures.read_text().splitlines()]
    for row in captures[1:]:
        row[0] = str(int(row[0]) + since)
    (folder / "movie_metadata.csv").write_text("".join(",".join(row) + "\n" for row in captures))
    # The first capture was not encoded, and timestamps are cut to microseconds.
    (folder / "frame_timestamps.txt").write_text("Frame timestamp[nanosec]\n1000299999000\n1004999999000\n")
    for name in ("frame0.png", "frame7.png", "1000200000000.png", "cover.png", "998000000000.png"):
        shutil.copy(files.photo, folder / "frames" / name)
    found = entries(run, folder, "--camera", files.camera, "-o", folder / "out", code=SOME_FAILED)
    assert [Path(item["photo"]).name for item in found] == sorted(path.name for path in (folder / "frames").iterdir())
    assert states(found) == "done failed failed done failed"
    assert "the nearest capture is 2200.0 ms away" in found[1]["error"]
    assert "neither a timestamp nor a frame number" in found[2]["error"]
    assert "there is no frame 7; the frames are 0 to 1" in found[4]["error"]
    assert (folder / "out" / "frames" / "frame0.png").is_file()
