"""Bad input: exit code 1, one line on stderr that names the file, no traceback, nothing written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur.motion.camera import Camera

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]

START, DURATION = 0.2, 0.04


def refused(result: Result, *words: object) -> None:
    """Check that a command ended with one line of error that contains `words`."""
    assert result.exit_code == 1, result.output
    errors = [line for line in result.stderr.splitlines() if not line.startswith("rsdeblur: warning: ")]
    assert len(errors) == 1, result.stderr
    assert errors[0].startswith("rsdeblur: error: ")
    for word in words:
        assert str(word) in errors[0]


def gap(files: Files) -> Path:
    log = files.samples()
    files.write_gyro(np.concatenate([log[:44], log[50:]]))
    return files.gyro


def short_log(files: Files) -> Path:
    log = files.samples()
    files.write_gyro(log[:46])
    return files.gyro


def other_clock(files: Files) -> Path:
    log = files.samples()
    log[:, 0] += 5000.0
    files.write_gyro(log)
    return files.gyro


def empty_log(files: Files) -> Path:
    files.gyro.write_bytes(b"")
    return files.gyro


def missing_log(files: Files) -> Path:
    files.gyro.unlink()
    return files.gyro


def no_picture(files: Files) -> Path:
    files.photo.write_text("this is no picture\n")
    return files.photo


def missing_picture(files: Files) -> Path:
    files.photo.unlink()
    return files.photo


def other_size(files: Files) -> Path:
    Image.new("RGB", (80, 72)).save(files.photo)
    return files.photo


def kernel_too_large(files: Files) -> Path:
    Camera(96, 72, 9000.0, readout_time=0.03).save(files.camera)
    return files.photo


def broken_camera(files: Files) -> Path:
    files.camera.write_text("width = 96\nheigth = 72\nfocal_length = 110\n")
    return files.camera


BAD: dict[Callable[[Files], Path], str] = {
    gap: "a gap of",
    short_log: "at its end",
    other_clock: "unrelated clocks",
    empty_log: "",
    missing_log: "",
    no_picture: "",
    missing_picture: "",
    other_size: "80x72",
    kernel_too_large: "more than the picture of 96x72 px",
    broken_camera: "did you mean 'height'",
}


@pytest.mark.parametrize("spoil", BAD, ids=lambda spoil: spoil.__name__)
def test_bad_files(run: Run, files: Files, tmp_path: Path, spoil: Callable[[Files], Path]) -> None:
    culprit = spoil(files)
    out = tmp_path / "out.png"
    refused(run("deblur", files.photo, *files.recording, "-o", out), culprit, BAD[spoil])
    assert not out.exists()


NUMBERS = [
    ("--duration", "0", "0 is not greater than 0"),
    ("--readout-time", "-30ms", "-30ms is less than 0"),
    ("--start-ns", str(2**70), "not a whole number of 64 bits"),
    ("--start", "1e300", "start must be"),
    ("--time-offset", "1e400", "is not a time"),
    ("--bias", "0,nan,0", "is not right"),
    *(
        (option, "nan", "is not a finite number")
        for option in ("--focal-length", "--weight", "--transfer", "--softness")
    ),
]


@pytest.mark.parametrize(("option", "value", "message"), NUMBERS)
def test_numbers_out_of_range_are_wrong_usage(
    run: Run, files: Files, tmp_path: Path, option: str, value: str, message: str
) -> None:
    result = run("deblur", files.photo, *files.recording, option, value, "-o", tmp_path / "o.png")
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr


def test_a_time_in_another_unit_is_asked_back(run: Run, files: Files, tmp_path: Path) -> None:
    call = ("deblur", files.photo, *files.sources, "-o", tmp_path / "o.png")
    refused(run(*call, "--start", "200", "--duration", "1/25"), "did you mean --start 200ms?")
    refused(run(*call, "--start", "0.2", "--duration", "50"), "did you mean 50ms or 1/50?")
    refused(run(*call, "--start", "0.2", "--duration", "0.7"), "give a longer recording")
    # A log in Unix time, of which only the seconds from its start are given.
    files.write_gyro(files.samples() + np.array([1560, 0, 0, 0]))
    refused(run(*call, "--start", "0.2", "--duration", "1/25"), "did you mean --start 1560.2,")
    refused(run(*call, "--start-ns", "1560200", "--duration", "1/25"), "did you mean --start-ns 1560200000000?")


def test_a_time_beyond_all_clocks_is_refused(run: Run, files: Files, tmp_path: Path) -> None:
    result = run("deblur", files.photo, *files.recording, "--time-offset", "1e300", "-o", tmp_path / "o.png")
    refused(result, "time_offset must be at most 1e+12, got 1e+300")


def test_degrees_warn_in_one_line(run: Run, files: Files, tmp_path: Path) -> None:
    log = files.samples()
    log[:, 1:] *= 10.0
    log[60:, 1] += 60.0
    files.write_gyro(log)
    result = run("info", files.gyro, "--gyro", files.gyro, "--camera", files.camera, "--capture", files.captures)
    assert result.exit_code == 0
    assert result.stderr.startswith("rsdeblur: warning: ")
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "--capture FILE --index N, --start or --start-ns, and its time: --duration"),
        (["--start", 0.2], "--duration"),
        (["--duration", 0.04], "--capture"),
        (["--index", 1], "--index needs --capture"),
        (["--start", 0.2, "--start-ns", 3, "--duration", 1], "exclude"),
        (["--capture", "frames.csv"], "--index 0 to 2"),
    ],
)
def test_the_exposure_must_be_given_once(
    run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[object], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("deblur", files.photo, *files.sources, *options, "-o", "o.png")
    assert (result.exit_code, words in result.stderr) == (2, True), result.stderr


def test_input_that_looks_wrong_warns(run: Run, files: Files, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asarray(Image.open(files.photo)).astype(np.float32) / 255)
    call = ("deblur", tmp_path / "a.npy", *files.recording, "--quality", "fast", "--force", "-o", tmp_path / "o.npy")
    assert "warning: the picture has floats, which mean linear light" in run(*call).stderr
    assert run(*call, "--transfer", "linear").stderr == ""
    result = run(*call, "--transfer", "linear", "--prior", "tv", "--nsr", 0.01)
    assert "warning: --nsr is the strength of --prior wiener" in result.stderr


def test_capture_out_of_range(run: Run, files: Files, tmp_path: Path) -> None:
    arguments = [*files.sources, "--capture", files.captures, "--index", 7]
    refused(run("deblur", files.photo, *arguments, "-o", tmp_path / "o.png"), files.captures, "contains 3")


def test_nothing_is_overwritten_without_force(run: Run, files: Files, tmp_path: Path) -> None:
    out = tmp_path / "o.png"
    out.write_bytes(b"precious")
    # The photo is missing, so a refusal that names the output came before any reading.
    refused(run("deblur", tmp_path / "none.png", *files.recording, "-o", out), out, "--force")
    bank = tmp_path / "o.npz"
    bank.write_bytes(b"precious")
    refused(run("psf", "--picture", tmp_path / "none.png", *files.recording, "--bank", bank), bank, "--force")
    folder = tmp_path / "out"
    page = ["compare", tmp_path / "none.png", *files.recording, "-o", folder, "--report"]
    (tmp_path / "r.html").write_bytes(b"precious")
    refused(run(*page, tmp_path / "r.html"), tmp_path / "r.html", "--force")
    refused(run(*page, tmp_path / "r.pdf"), tmp_path / "r.pdf", "HTML page")
    assert out.read_bytes() == b"precious"
    assert run("deblur", files.photo, *files.recording, "--force", "-o", out).exit_code == 0
    assert out.read_bytes() != b"precious"


@pytest.mark.parametrize(
    ("command", "name"), [("compare", "banded.png"), ("simulate", "rolling.png"), ("demo", "compare.json")]
)
def test_folders_are_not_overwritten_either(run: Run, files: Files, tmp_path: Path, command: str, name: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_bytes(b"precious")
    arguments = [] if command == "demo" else [tmp_path / "none.png", *files.recording]
    refused(run(command, *arguments, "-o", out), out / name, "--force")
    assert [path.read_bytes() for path in out.iterdir()] == [b"precious"]


@pytest.mark.parametrize("command", ["compare", "simulate", "demo", "batch"])
def test_a_folder_is_not_given_the_name_of_a_picture(run: Run, files: Files, tmp_path: Path, command: str) -> None:
    out = tmp_path / "out.png"
    manifest = tmp_path / "list.csv"
    manifest.write_text(f"photo\n{files.photo}\n")
    arguments = {"demo": [], "batch": [manifest, *files.sources]}.get(command, [files.photo, *files.recording])
    refused(run(command, *arguments, "-o", out), out, "the output is a folder")
    assert not out.exists()


def test_unwritable_outputs(run: Run, files: Files, tmp_path: Path) -> None:
    missing = tmp_path / "none" / "o.png"
    refused(run("deblur", files.photo, *files.recording, "-o", missing), missing)
    (tmp_path / "file").write_text("")
    refused(run("compare", files.photo, *files.recording, "-o", tmp_path / "file" / "out"), tmp_path / "file")
    refused(run("psf", *files.recording, "--bank", tmp_path / "none" / "b.npz"), tmp_path / "none" / "b.npz")


@pytest.mark.parametrize("command", ["deblur", "psf"])
def test_unknown_picture_extensions_are_refused_before_any_work(
    run: Run, files: Files, tmp_path: Path, command: str
) -> None:
    out, missing = tmp_path / "o.bmp", tmp_path / "none.png"
    photo = [missing] if command == "deblur" else ["--picture", missing]
    refused(run(command, *photo, *files.recording, "-o", out), out, "unknown picture extension '.bmp'")


def test_info_on_unknown_files(run: Run, files: Files, tmp_path: Path) -> None:
    strange = tmp_path / "strange.bin"
    strange.write_bytes(bytes(range(256)) * 8)
    refused(run("info", strange), strange)
    table = tmp_path / "rates.csv"
    table.write_text("time_ms,rot_x,rot_y,rot_z\n0,1,2,3\n")
    refused(
        run("info", table), table, "unknown gyro log format", "like t,wx,wy,wz", "not a camera file, a capture file"
    )
    mixed = run("info", strange, files.camera)
    refused(mixed, strange)
    assert f"{files.camera}: camera" in mixed.stdout
    missing = run("info", tmp_path / "none.csv")
    refused(missing, tmp_path / "none.csv", "there is no such file")
    assert missing.stdout == ""
    refused(run("info", "/dev/null"), "/dev/null: not a regular file")
    assert run("info", "--gyro", files.gyro).exit_code == 2
    refused(run("simulate", files.photo, *files.sources, "--start", 9, "--duration", DURATION, "-o", tmp_path / "s"),
            files.gyro)  # fmt: skip


def test_an_own_kernel_excludes_a_recording(run: Run, files: Files, tmp_path: Path) -> None:
    kernel, out = tmp_path / "kernel.npy", tmp_path / "o.png"
    np.save(kernel, np.eye(5))
    for more, words in (
        (files.recording, "no meaning: --gyro, --camera, --start, --duration"),
        (["--mode", "rowwise", "--softness", "0.5"], "no meaning: --mode, --softness"),
    ):
        result = run("deblur", files.photo, "--psf", kernel, *more, "-o", out)
        assert (result.exit_code, words in result.stderr) == (2, True), result.stderr
    result = run("deblur", files.photo, "--gyro", files.gyro, "-o", out)
    assert (result.exit_code, "--camera missing" in result.stderr) == (2, True), result.stderr
    refused(run("deblur", files.photo, "--psf", files.gyro, "-o", out), files.gyro)
    np.save(kernel, np.ones((99, 99)))
    refused(run("deblur", files.photo, "--psf", kernel, "-o", out), kernel, "larger than the picture")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["deblur", ""], "the name is empty"),
        (["deblur", "/", "-o", "a.png"], "this is a folder, not a photo"),
        (["deblur", "PHOTO", "-o", ""], "the name is empty"),
        (["deblur", "PHOTO", "--translation-axes", "imu"], "--translation-axes belongs to --translation"),
        (["psf", "--bank", "kernels.png"], "a bank of kernels is an NPZ file"),
        (["sync", "PHOTO", "--from", "10ms", "--to", "-10ms"], "--from 10ms must be less than --to -10ms"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(
    run: Run, files: Files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*[files.photo if word == "PHOTO" else word for word in command], *files.recording)
    assert result.exit_code in (1, 2)
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["compare", "simulate"])
def test_refused_photos_leave_no_folder(run: Run, files: Files, tmp_path: Path, command: str) -> None:
    assert run(command, tmp_path / "none.png", *files.recording, "-o", tmp_path / "a" / "b").exit_code == 1
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("deblur", "--mode global --bands 4", "--bands has no effect with --mode global; use --mode banded"),
        ("deblur", "--mode global --strips 2", "--strips has no effect with --mode global; use"),
        ("deblur", "--quality best --bands 4", "--bands has no effect with --mode rowwise"),
        ("deblur", "--prior wiener --weight 0.1", "--weight: the prior wiener has no weight"),
        ("deblur", "--prior tv --exponent 0.5", "--exponent: exponent belongs to the prior"),
        ("deblur", "--mode rowwise --border unknown", "--border: the mode rowwise takes no border unknown"),
        ("deblur", "--refine --max-memory 1GB", "--max-memory: refine needs the whole picture"),
        ("deblur", "--nsr nan", "nan is not a finite number"),
        ("psf", "--mode global --bands 4", "--bands has no effect"),
        ("compare", "--mode global --strips 2", "--strips has no effect with --mode global; use"),
        ("compare", "--mode global --mode rowwise --bands 3", "--bands has no effect with --mode global and rowwise"),
        ("batch", "--mode global --strips 2", "--strips has no effect"),
    ],
)
def test_options_without_effect_are_wrong_usage(
    run: Run, files: Files, tmp_path: Path, command: str, options: str, message: str
) -> None:
    inputs: list[Path | object] = [] if command == "psf" else [files.photo]
    recording = files.sources if command == "batch" else files.recording
    result = run(command, *inputs, *recording, *options.split(), "-o", tmp_path / "o.png")
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr
    assert not (tmp_path / "o.png").exists()


def test_exchanged_files_are_named(run: Run, files: Files, tmp_path: Path) -> None:
    moment = ("--start", START, "--duration", DURATION, "-o", tmp_path / "o.png")
    exchanged = run("deblur", files.photo, "--gyro", files.camera, "--camera", files.gyro, *moment)
    refused(exchanged, files.gyro, "it looks like a gyro log", "give it as --gyro")
    capture = ("--capture", files.gyro, "--duration", DURATION, "-o", tmp_path / "o.png")
    refused(run("deblur", files.photo, *files.sources, *capture), files.gyro, "give it as --gyro")
    refused(
        run("deblur", files.gyro, *files.recording, "-o", tmp_path / "o.png"), "not a picture: it looks like a gyro log"
    )
    for manifest, kind in ((files.photo, "picture"), (files.gyro, "gyro log"), (files.captures, "capture file")):
        refused(run("batch", manifest, "-o", tmp_path / "o"), manifest, f"not a manifest: it looks like a {kind}")
    manifest = tmp_path / "m.csv"
    manifest.write_text(f"photo,start,duration\n{files.photo.name},0.2,0.04\n" * 2)
    for shared in (("--gyro", files.camera), ("--camera", files.gyro), ("--capture", files.gyro)):
        for command in (["batch", "-o", tmp_path / "o"], ["triage"]):
            refused(run(*command, manifest, *files.sources, *shared), f"{shared[1]}: not a", "it looks like a")
    assert not (tmp_path / "o").exists()
