"""Files of strangers: any name and any content is a row, and nothing that a terminal or a spreadsheet would obey."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import Result
from PIL import Image

import rsdeblur.cli

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]

FAST = ("--mode", "global", "--quality", "fast", "--nsr", "0.01", "--jobs", "1")
# ESC ] 0 ; title BEL sets the title of a terminal; U+202E turns the text after it around.
TITLE = "\x1b]0;PWN\x07"
NAMES = (
    TITLE + "a.png",
    "line\nbreak.png",
    "=1+1.png",
    "@SUM(1).png",
    "[copy]a.png",
    ":smile:.png",
    "\u202egnp.png",
    os.fsdecode(b"fr\xe9.png"),
    "12:30.png",
    "写真　1.png",
)
# All that a terminal shows as it is.
PLAIN = re.compile(r"[^\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\ud800-\udfff]*")


def session(files: Files, folder: Path) -> Path:
    """Write a session of one exposure, without photos."""
    (folder / "frames").mkdir(parents=True)
    shutil.copy(files.gyro, folder / "gyro.csv")
    shutil.copy(files.captures, folder / "frames.csv")
    return folder


def items(out: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((out / "batch.json").read_text("utf-8"))["items"]
    return found


@pytest.mark.usefixtures("here")
def test_no_name_of_a_photo_ends_a_session(run: Run, files: Files, tmp_path: Path) -> None:
    folder, out = session(files, tmp_path / "session"), tmp_path / "out"
    for i, name in enumerate(NAMES):
        shutil.copy(files.photo, folder / "frames" / f"{name.removesuffix('.png')}_{i % 2}.png")
    (folder / "[").mkdir()
    shutil.copy(files.photo, folder / "[" / "x]_0.png")
    result = run("batch", folder, "--camera", files.camera, "--numbered-from", "0", *FAST, "-o", out)
    assert result.exit_code == 0, result.output
    assert PLAIN.fullmatch(result.output)
    assert f"{len(NAMES) + 1} done" in result.stdout
    assert {item["state"] for item in items(out)} == {"done"}


@pytest.mark.usefixtures("here")
def test_no_cell_of_a_manifest_ends_it(run: Run, files: Files, tmp_path: Path) -> None:
    path, out = tmp_path / "m.csv", tmp_path / "out"
    for name in ("=1+1.png", "@a.png", "+a.png"):
        shutil.copy(files.photo, tmp_path / name)
    bad = [
        "photo\0.png,a.png",
        "photo.png,b\0.png",
        f"{'p' * 255}.png,c.png",
        f"photo.png,{'o' * 255}.png",
        f"{'x' * 140_000},d.png",
        f"photo.png,{'y' * 140_000}",
        '"photo\n.png",e.png',
        "photo.png,[/f].txt",
        f"{'a/' * 1500}b.png,g.png",
        "photo.png,.",
    ]
    good = ["=1+1.png,", "@a.png,", "+a.png,"]
    recording = f",0.2,0.04,{files.gyro},{files.camera}"
    path.write_text("photo,output,start,duration,gyro,camera\n" + "".join(f"{row}{recording}\n" for row in bad + good))
    result = run("batch", path, *FAST, "-o", out)
    assert result.exit_code == 3, result.output
    assert PLAIN.fullmatch(result.output)
    found = items(out)
    assert [item["state"] for item in found] == ["failed"] * len(bad) + ["done"] * len(good)
    assert all(item["error"] for item in found[: len(bad)])


def test_no_command_replaces_its_input(run: Run, files: Files, tmp_path: Path) -> None:
    (tmp_path / "link.png").symlink_to(files.photo)
    before = files.photo.read_bytes()
    os.link(files.gyro, tmp_path / "gyro.tif")
    (tmp_path / "out").mkdir()
    os.link(files.photo, tmp_path / "out" / "banded.png")
    deblur = ("deblur", files.photo, *files.recording, "--force", "-o")
    for arguments in (
        (*deblur, files.photo),
        (*deblur, tmp_path / "link.png"),
        (*deblur, tmp_path / "gyro.tif"),
        ("compare", files.photo, *files.recording, "--force", "-o", tmp_path / "out"),
        ("psf", "--picture", files.photo, *files.recording, "--force", "-o", files.photo),
        ("camera", "import", files.camera, "--force", "-o", files.camera),
    ):
        result = run(*arguments)
        assert result.exit_code == 1, arguments
        assert "the result would replace an input" in result.stderr
    assert files.photo.read_bytes() == before


def exif(maker: str) -> bytes:
    block = Image.Exif()
    block[271] = maker
    return block.tobytes()


def test_nothing_but_text_reaches_the_terminal(run: Run, files: Files, tmp_path: Path) -> None:
    folder = tmp_path / TITLE
    folder.mkdir()
    photo, camera = folder / "photo.jpg", folder / "camera.toml"
    Image.open(files.photo).save(photo, exif=exif(f"{TITLE}maker\nrsdeblur: error: forged"), quality=95)
    shutil.copy(files.camera, camera)
    log = folder / "log.gcsv"
    samples = "".join(f"{t},{a},{b},{c}\n" for t, a, b, c in files.samples())
    log.write_text(
        f"GYROFLOW IMU LOG\nversion,1.3\nid,{TITLE}\norientation,XYZ\ntscale,1\ngscale,1\nt,gx,gy,gz\n{samples}"
    )
    recording = ("--gyro", files.gyro, "--camera", camera, "--start", "0.2", "--duration", "0.04")
    for arguments in (
        ("info", photo, log, camera, folder / "none.csv"),
        ("info", "--json", photo, log),
        ("deblur", photo, *recording, "--mode", "global", "--prior", "wiener", "-o", folder / "o.png"),
        ("deblur", photo, *recording, "--dry-run", "-o", folder / "p.png"),
        ("deblur", photo, *files.sources, "--capture", files.captures, "-o", folder / "q.png"),
        ("psf", *recording, "-o", folder / "psf.png"),
        ("psf", f"--{TITLE}"),
        (TITLE,),
    ):
        output: Any = run(*arguments)
        assert PLAIN.fullmatch(output.output), arguments
        assert not re.search("^(rsdeblur: error: )?forged", output.output, re.MULTILINE)


def test_only_one_module_prints() -> None:
    """Else a text could reach the terminal unescaped."""
    folder = Path(rsdeblur.cli.__file__).parent
    printing = re.compile(r"\bclick\.(secho|echo)\b|(?<!\w)print\(|Console\(|sys\.(stdout|stderr)\.write")
    assert [path.name for path in folder.glob("*.py") if printing.search(path.read_text())] == ["_output.py"]


@pytest.mark.parametrize(("locale", "encoding"), [("C", "ascii"), ("C.UTF-8", "utf-8")])
def test_stdout_takes_any_name(files: Files, tmp_path: Path, locale: str, encoding: str) -> None:
    """In a UTF-8 locale stdout is strict, whatever names the files have."""
    name = os.fsencode(tmp_path) + "/é".encode() + b"\xe9.png"
    shutil.copy(files.photo, name)
    command = [sys.executable, "-m", "rsdeblur", "info", name]
    # An empty handler after the colon is Python's default for the encoding: strict.
    environment = os.environ | {"LC_ALL": locale, "PYTHONIOENCODING": f"{encoding}:strict", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert rb"\udce9.png: picture" in done.stdout


@pytest.mark.parametrize(("value", "code"), [("0", 1), ("x", 0)])
def test_an_environment_that_numba_refuses_is_one_line(files: Files, value: str, code: int) -> None:
    environment = os.environ | {"NUMBA_NUM_THREADS": value, "SOURCE_DATE_EPOCH": "9" * 14}
    command = [sys.executable, "-m", "rsdeblur", "psf", *map(str, files.recording)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    (line,) = (line for line in done.stderr.splitlines() if "NUMBA_NUM_THREADS" in line)
    assert (done.returncode, "Traceback" in done.stderr) == (code, False), line


def test_a_closed_stderr_is_no_error(files: Files, tmp_path: Path) -> None:
    out = tmp_path / "o.png"
    fast = "--mode global --prior wiener --nsr 0.01"
    command = f'exec "{sys.executable}" -m rsdeblur deblur "$0" "$@" {fast} -o "{out}" 2>&-'
    done = subprocess.run(["sh", "-c", command, files.photo, *files.recording], capture_output=True, check=False)
    assert done.returncode == 0
    assert out.is_file()
