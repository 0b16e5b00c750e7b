"""Bad input: exit code 1 or 2, one line on stderr that names the file, no traceback, nothing written."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur.motion.camera import Camera

START, DURATION = 0.2, 0.04


def refused(result: Result, *words: object) -> None:
    """Check that a command ended with one line of error that contains `words`."""
    assert result.exit_code == 1, result.output
    errors = [line for line in result.stderr.splitlines() if not line.startswith("rsdeblur: warning: ")]
    assert len(errors) == 1, result.stderr
    assert errors[0].startswith("rsdeblur: error: ")
    for word in words:
        assert str(word) in errors[0]


def kept(samples: Callable[[np.ndarray], np.ndarray]) -> Callable[[Any], None]:
    """Return a function that changes the samples of the log."""
    return lambda files: files.write_gyro(samples(files.samples()))


# What is wrong with which file, how it becomes so, and a part of the message.
BAD: dict[tuple[str, str], tuple[Callable[[Any], object], str]] = {
    ("gyro", "gap"): (kept(lambda log: np.concatenate([log[:44], log[50:]])), "a gap of"),
    ("gyro", "short"): (kept(lambda log: log[:46]), "at its end"),
    ("gyro", "clock"): (kept(lambda log: np.add(log, [5000, 0, 0, 0])), "unrelated clocks"),
    ("gyro", "empty"): (lambda files: files.gyro.write_bytes(b""), ""),
    ("gyro", "missing"): (lambda files: files.gyro.unlink(), ""),
    ("photo", "text"): (lambda files: files.photo.write_text("this is no picture\n"), ""),
    ("photo", "missing"): (lambda files: files.photo.unlink(), ""),
    ("photo", "size"): (lambda files: Image.new("RGB", (80, 72)).save(files.photo), "80x72"),
    ("photo", "blur"): (lambda files: Camera(96, 72, 9000.0, readout_time=0.03).save(files.camera), "more than the"),
    ("camera", "key"): (lambda files: files.camera.write_text("width = 96\nheigth = 72\n"), "did you mean 'height'"),
}


@pytest.mark.parametrize("bad", BAD, ids="-".join)
def test_bad_files(run, files, tmp_path: Path, bad: tuple[str, str]) -> None:
    spoil, message = BAD[bad]
    spoil(files)
    out = tmp_path / "out.png"
    refused(run("deblur", files.photo, *files.recording, "-o", out), getattr(files, bad[0]), message)
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--duration 0", "0.0 is not in the range x>0"),
        ("--readout-time -30ms", "-0.03 is not in the range x>=0"),
        (f"--start-ns {2**70}", "not a whole number of 64 bits"),
        ("--time-offset 1e400", "is not a time"),
        ("--bias 0,nan,0", "is not right"),
        ("--focal-length nan", "is not a finite number"),
        ("--start-ns 3", "--start and --start-ns exclude each other"),
        ("--index 1", "--index needs --capture"),
        ("--mode global --bands 4", "--bands has no effect with --mode global; use --mode banded"),
        ("--prior wiener --weight 0.1", "--weight: the prior wiener has no weight"),
        ("--refine --max-memory 1GB", "--max-memory: refine needs the whole picture"),
        ("--psf kernel.npy", "no meaning: --gyro, --camera, --start, --duration"),
    ],
)
def test_options_that_cannot_be_meant(run, files, tmp_path: Path, options: str, message: str) -> None:
    result = run("deblur", files.photo, *files.recording, *options.split(), "-o", tmp_path / "o.png")
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr
    assert not (tmp_path / "o.png").exists()


@pytest.mark.parametrize(
    ("command", "code", "message"),
    [
        ("deblur '' RECORDING", 2, "the name is empty"),
        ("deblur / RECORDING -o a.png", 1, "this is a folder, not a photo"),
        ("deblur PHOTO RECORDING -o ''", 2, "the name is empty"),
        ("deblur PHOTO --gyro gyro.csv", 2, "the exposure is missing"),
        ("deblur PHOTO --camera camera.toml", 2, "formats"),
        ("deblur PHOTO SOURCES", 2, "--capture FILE --index N, --start or --start-ns, and its time: --duration"),
        ("deblur PHOTO SOURCES --capture frames.csv", 2, "--index 0 to 2"),
        ("deblur PHOTO SOURCES --capture frames.csv --index 7", 1, "frames.csv: there is no exposure 7"),
        ("deblur PHOTO --psf gyro.csv", 1, "gyro.csv"),
        ("deblur PHOTO RECORDING -o none/o.png", 1, "none"),
        ("deblur none.png RECORDING -o o.bmp", 1, "unknown picture extension '.bmp'"),
        ("deblur PHOTO RECORDING --time-offset 1e300 -o o.png", 1, "time_offset must be at most 1e+12, got 1e+300"),
        ("psf RECORDING --bank kernels.png", 1, "a bank of kernels is an NPZ file"),
        ("psf --start 1", 2, "--gyro"),
        ("psf --disc 3", 2, "needs -o"),
        ("psf --line 3 -o k.png", 2, "12,30"),
        ("sync PHOTO RECORDING --numbered-from 1", 2, "--numbered-from is for several photos"),
        ("sync PHOTO PHOTO RECORDING", 2, "--start is one moment"),
        ("sync PHOTO RECORDING --from 10ms --to -10ms", 2, "--from 10ms must be less than --to -10ms"),
        ("compare PHOTO RECORDING --mode global --mode rowwise --bands 3", 2, "with --mode global and rowwise"),
        ("compare none.png RECORDING -o a/b", 1, "none.png"),
        ("compare PHOTO RECORDING -o gyro.csv/out", 1, "gyro.csv"),
        ("compare PHOTO RECORDING -o a --report r.pdf", 1, "HTML page"),
        ("simulate PHOTO SOURCES --start 9 --duration 0.04 -o s", 1, "gyro.csv"),
        ("info none.csv", 1, "none.csv: cannot read the file: No such file"),
        ("info /dev/null", 1, "/dev/null: cannot read the file: it is a pipe"),
        ("info --gyro gyro.csv", 2, "are needed together"),
    ],
)
def test_commands_that_are_refused(run, files, tmp_path: Path, monkeypatch, command: str, code: int, message: str):
    monkeypatch.chdir(tmp_path)
    before = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    words: list[Any] = []
    for word in command.split():
        words += {"PHOTO": ["photo.png"], "''": [""], "RECORDING": files.recording, "SOURCES": files.sources}.get(
            word, [word]
        )
    result = run(*words)
    assert (result.exit_code, message in result.stderr) == (code, True), result.stderr
    if code == 1:
        refused(result)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == before


def test_a_time_in_another_unit_is_asked_back(run, files, tmp_path: Path) -> None:
    call = ("deblur", files.photo, *files.sources, "-o", tmp_path / "o.png")
    refused(run(*call, "--start", "200", "--duration", "1/25"), "did you mean --start 200ms?")
    refused(run(*call, "--start", "0.2", "--duration", "50"), "did you mean 50ms or 1/50?")
    refused(run(*call, "--start", "0.2", "--duration", "0.7"), "give a longer recording")
    # A log in Unix time, of which only the seconds from its start are given.
    files.write_gyro(files.samples() + np.array([1560, 0, 0, 0]))
    refused(run(*call, "--start", "0.2", "--duration", "1/25"), "did you mean --start 1560.2,")
    refused(run(*call, "--start-ns", "1560200", "--duration", "1/25"), "did you mean --start-ns 1560200000000?")


def test_input_that_looks_wrong_warns_in_one_line(run, files, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asarray(Image.open(files.photo)).astype(np.float32) / 255)
    call = ("deblur", tmp_path / "a.npy", *files.recording, "--quality", "fast", "--force", "-o", tmp_path / "o.npy")
    assert "warning: the picture has floats, which mean linear light" in run(*call).stderr
    assert run(*call, "--transfer", "linear").stderr == ""
    assert "warning: --nsr is the strength of --prior wiener" in run(*call, "--prior", "tv", "--nsr", 0.01).stderr
    # Rates in degrees.
    log = files.samples() * [1, 10, 10, 10]
    log[60:, 1] += 60.0
    files.write_gyro(log)
    call = ("info", files.gyro, "--unit", "rad/s", "--gyro", files.gyro, "--camera", files.camera)
    result = run(*call, "--capture", files.captures)
    assert (result.exit_code, len(result.stderr.splitlines())) == (0, 1)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("deblur", "o.png"),
        ("psf", "o.npz"),
        ("compare", "banded.png"),
        ("simulate", "rolling.png"),
        ("demo", "compare.json"),
    ],
)
def test_nothing_is_overwritten_without_force(run, files, tmp_path: Path, command: str, name: str) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).write_bytes(b"precious")
    # The photo is missing, so a refusal that names the output came before any reading.
    photo = {"psf": ["--picture", tmp_path / "none.png"], "demo": []}.get(command, [tmp_path / "none.png"])
    output = {"psf": ["--bank", folder / name], "deblur": ["-o", folder / name]}.get(command, ["-o", folder])
    recording = [] if command == "demo" else files.recording
    refused(run(command, *photo, *recording, *output), folder / name, "--force")
    assert [path.read_bytes() for path in folder.iterdir()] == [b"precious"]
    if command == "deblur":
        assert run(command, files.photo, *recording, "--quality", "fast", "--force", *output).exit_code == 0
        assert (folder / name).read_bytes() != b"precious"


@pytest.mark.parametrize("command", ["compare", "simulate", "demo", "batch"])
def test_a_folder_is_not_given_the_name_of_a_picture(run, files, tmp_path: Path, command: str) -> None:
    out = tmp_path / "out.png"
    manifest = tmp_path / "list.csv"
    manifest.write_text(f"photo\n{files.photo}\n")
    arguments = {"demo": [], "batch": [manifest, *files.sources]}.get(command, [files.photo, *files.recording])
    refused(run(command, *arguments, "-o", out), out, "the output is a folder")
    assert not out.exists()


def test_info_on_unknown_files(run, files, tmp_path: Path) -> None:
    strange, table = tmp_path / "strange.bin", tmp_path / "rates.csv"
    strange.write_bytes(bytes(range(256)) * 8)
    table.write_text("time_ms,rot_x,rot_y,rot_z\n0,1,2,3\n")
    words = "unknown gyro log format", "--columns t=1,gx=2,gy=3,gz=4", "not a camera file, a capture file"
    refused(run("info", table), table, *words)
    # The other files are described all the same.
    mixed = run("info", strange, files.camera)
    refused(mixed, strange)
    assert f"{files.camera}: camera" in mixed.stdout


def test_exchanged_files_are_named(run, files, tmp_path: Path) -> None:
    moment = ("--start", START, "--duration", DURATION, "-o", tmp_path / "o.png")
    exchanged = run("deblur", files.photo, "--gyro", files.camera, "--camera", files.gyro, *moment)
    refused(exchanged, files.gyro, "it looks like a gyro log", "give it as --gyro")
    capture = ("--capture", files.gyro, "--duration", DURATION, "-o", tmp_path / "o.png")
    refused(run("deblur", files.photo, *files.sources, *capture), files.gyro, "give it as --gyro")
    refused(run("deblur", files.gyro, *files.recording), "not a picture: it looks like a gyro log")
    for manifest, kind in ((files.photo, "picture"), (files.gyro, "gyro log"), (files.captures, "capture file")):
        refused(run("batch", manifest, "-o", tmp_path / "o"), manifest, f"not a manifest: it looks like a {kind}")
    manifest = tmp_path / "m.csv"
    manifest.write_text(f"photo,start,duration\n{files.photo.name},0.2,0.04\n" * 2)
    for shared in (("--gyro", files.camera), ("--camera", files.gyro), ("--capture", files.gyro)):
        for command in (["batch", "-o", tmp_path / "o"], ["triage"]):
            refused(run(*command, manifest, *files.sources, *shared), f"{shared[1]}: not a", "it looks like a")
    assert not (tmp_path / "o").exists()
