"""Faults: a full disk, a killed process, an interrupt, a damaged cache.

No file is lost, and none is left half written.
"""

import errno
import importlib
import importlib.util
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from rsdeblur import Camera, OutputError, PsfBank, read_picture, write_picture
from rsdeblur._util.files import atomic_write, check_target

KILLS = 4
SIDE = 200


def _picture(name: str) -> tuple[Callable[[Path, int], None], Callable[[Path], Any]]:
    pictures = [np.random.default_rng(i).integers(0, 256, (SIDE, SIDE, 3), np.uint8) for i in range(2)]
    return lambda path, i: write_picture(path, pictures[i], force=True), lambda path: read_picture(path).pixels


def _write(path: Path, which: int) -> None:
    with atomic_write(path) as file:
        file.write(bytes([which]) * 50_000)


WRITERS: dict[str, tuple[Callable[[Path, int], None], Callable[[Path], Any]]] = {
    **{name: _picture(name) for name in ("a.jpg", "a.png", "a.tif", "a.webp")},
    "camera.toml": (lambda path, i: Camera(640 + i, 480, 500.0).save(path), Camera.load),
    "bank.npz": (
        lambda path, i: PsfBank(np.full((2, 1, 3, 3), 1 / 9), np.arange(2.0) + i, np.zeros(1)).save(path),
        PsfBank.load,
    ),
    "batch.json": (_write, lambda path: path.read_bytes()),
}


def _write_for_ever(write: Callable[[Path, int], None], path: Path, ready: Any) -> None:
    which = 0
    while True:
        write(path, which)
        ready.set()
        which = 1 - which


def heed_interrupts() -> None:
    """Restore the default action: background jobs of a shell ignore interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("name", WRITERS)
def test_a_killed_process_leaves_the_old_file_or_the_new_one(tmp_path: Path, name: str) -> None:
    write, read = WRITERS[name]
    rng, context, path, whole = random.Random(name), get_context("fork"), tmp_path / name, []
    for which in range(2):
        write(path, which)
        whole.append(path.read_bytes())
    for _ in range(KILLS):
        ready = context.Event()
        process = context.Process(target=_write_for_ever, args=(write, path, ready))
        process.start()
        ready.wait()
        time.sleep(rng.uniform(0, 0.03))
        process.kill()
        process.join()
        read(path)
        assert path.read_bytes() in whole


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_reported_and_the_old_file_kept(tmp_path: Path, name: str) -> None:
    """Only a part of the file fits."""
    (write, _), path = WRITERS[name], tmp_path / name
    write(path, 0)
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for fifths in range(5):
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) * fifths // 5, limits[1]))
        try:
            with pytest.raises(OutputError, match=name):
                write(path, 1)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert path.read_bytes() == before
        assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_command_cleans_up(tmp_path: Path, number: int) -> None:
    """Ctrl-C, `kill` or a closed terminal while it writes: the shells' exit code, one line, no temporary file."""
    # A write that never ends, and prints when it has begun. Its sleep is in short pieces, because a signal that comes
    # just before the system's call does not end it: Python notices it when the call returns.
    code = (
        "import time, rsdeblur.cli, rsdeblur._util.files as atomic\n"
        "def slow(*_):\n    print('writing', flush=True)\n    while True: time.sleep(0.01)\n"
        "atomic.os.fsync = slow\n"
        "rsdeblur.cli.main()\n"
    )
    target = tmp_path / "camera.toml"
    arguments = ["camera", "new", "--size", "640x480", "--focal-length", "500", "-o", str(target)]
    command = [sys.executable, "-c", code, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, preexec_fn=heed_interrupts, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n", process.communicate()
        process.send_signal(number)
        _, message = process.communicate(timeout=30)
    assert (process.returncode, message) == (128 + number, "rsdeblur: interrupted; no unfinished file is left\n")
    assert not list(tmp_path.iterdir())


def test_a_command_that_ignores_hangups_goes_on(tmp_path: Path) -> None:
    """As after `nohup`, whose commands must survive their terminal."""
    code = (
        "import os, signal, rsdeblur.cli, rsdeblur._util.files as atomic\n"
        "atomic.os.fsync = lambda _: os.kill(os.getpid(), signal.SIGHUP)\n"
        "rsdeblur.cli.main()\n"
    )
    arguments = ["camera", "new", "--size", "640x480", "--focal-length", "500", "-o", str(tmp_path / "camera.toml")]
    command = ["nohup", sys.executable, "-c", code, *arguments]
    process = subprocess.run(command, capture_output=True, check=False)
    assert process.returncode == 0, process.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["camera.toml"]


class TestPlaces:
    """A pipe, a folder or a device is never replaced by a file."""

    @pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
    def test_refused(self, tmp_path: Path, kind: str) -> None:
        path = tmp_path / "a.png"
        if kind == "device":
            path = Path("/dev/null")
        else:
            {"pipe": os.mkfifo, "folder": os.mkdir}[kind](path)
        mode = path.lstat().st_mode
        for write in (lambda: check_target(path, force=True), lambda: Camera(3, 3, 5.0).save(path)):
            with pytest.raises(OutputError, match=f"{path.name}: cannot write the file: "):
                write()
        assert path.lstat().st_mode == mode

    def test_names(self, tmp_path: Path) -> None:
        for name in ("a\0b.png", "a\ud800b.png", "x" * 256 + ".png"):
            with pytest.raises(OutputError, match="cannot write the file"):
                write_picture(tmp_path / name, np.zeros((3, 3)))
        odd = ("a\nb.png", "\udcff.png", "-.png", "😀" * 62 + ".png", "x" * 251 + ".png")
        for name in odd:
            write_picture(tmp_path / name, np.zeros((3, 3)))
        assert {path.name for path in tmp_path.iterdir()} == set(odd)

    def test_a_link_stays_a_link(self, tmp_path: Path) -> None:
        (tmp_path / "there").mkdir()
        file, link = tmp_path / "there" / "camera.toml", tmp_path / "link.toml"
        link.symlink_to(file)
        for camera in (Camera(3, 3, 5.0), Camera(4, 3, 5.0)):
            camera.save(link)
            assert link.is_symlink()
            assert Camera.load(file).width == camera.width
        with pytest.raises(OutputError, match="the file exists"):
            check_target(link, force=False)

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
    def test_a_read_only_folder(self, tmp_path: Path) -> None:
        tmp_path.chmod(0o500)
        for write in (lambda: check_target(tmp_path / "a", force=True), lambda: Camera(3, 3, 5.0).save(tmp_path / "a")):
            with pytest.raises(OutputError, match="cannot write the file"):
                write()

    def test_a_new_file_has_the_common_mode(self, tmp_path: Path) -> None:
        with atomic_write(tmp_path / "a") as file:
            file.write(b"a")
        (tmp_path / "b").write_bytes(b"b")
        assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def failing(number: int) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


class TestNumbaCache:
    """Numba alone raises at every later call what unpickling a damaged file raises, and fails where a disk is full."""

    SOURCE = "from rsdeblur.kernels._jit import njit\n\n\n@njit()\ndef double(x):\n    return 2 * x\n"

    def kernel(self, folder: Path, run: int) -> ModuleType:
        """Import the same source again, as the next process would."""
        spec = importlib.util.spec_from_file_location(f"kernel_{run}", folder / "kernel.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    @pytest.mark.parametrize("extension", ["nbi", "nbc"])
    @pytest.mark.parametrize("content", [b"", b"garbage"])
    def test_damaged(self, tmp_path: Path, extension: str, content: bytes) -> None:
        (tmp_path / "kernel.py").write_text(self.SOURCE)
        assert self.kernel(tmp_path, 0).double(2) == 4
        files = list((tmp_path / "__pycache__").glob(f"*.{extension}"))
        assert files
        for file in files:
            file.write_bytes(content)
        again = self.kernel(tmp_path, 1)
        assert again.double(3) == 6
        # The function was compiled again and saved.
        assert all(file.read_bytes() != content for file in files)
        assert self.kernel(tmp_path, 2).double.stats.cache_hits == {}
        hit = self.kernel(tmp_path, 3).double
        assert hit(4) == 8
        assert sum(hit.stats.cache_hits.values()) == 1

    def test_full(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "kernel.py").write_text(self.SOURCE)
        module = self.kernel(tmp_path, 0)
        monkeypatch.setattr(os, "replace", failing(errno.ENOSPC))
        assert module.double(2) == 4


def test_two_writers_of_one_file_both_finish(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with atomic_write(path) as first:
        first.write(b"1")
        with atomic_write(path) as second:
            second.write(b"2")
        assert path.read_bytes() == b"2"
    assert path.read_bytes() == b"1"
    assert list(tmp_path.iterdir()) == [path]


def test_a_replaced_file_keeps_mode_and_attributes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.touch(0o600)
    os.utime(path, (1, 1))
    try:
        os.setxattr(path, "user.origin", b"here")
        attributes = ["user.origin"]
    except (AttributeError, OSError):  # macOS, or a file system without them
        attributes = []
    with atomic_write(path) as file:
        file.write(b"a")
    assert path.stat().st_mode & 0o777 == 0o600
    assert [os.getxattr(path, name) for name in attributes] == [b"here"] * len(attributes)
    # It is another content, of another date.
    assert path.stat().st_mtime > 1


@pytest.mark.parametrize("number", [errno.EPERM, errno.EINVAL])
def test_a_disk_without_synchronisation_keeps_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    monkeypatch.setattr(os, "fsync", failing(number))
    write_picture(tmp_path / "a.tif", np.full((3, 4), 7, np.uint8))
    assert (read_picture(tmp_path / "a.tif").pixels == 7).all()


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    monkeypatch.setattr(os, call, failing(errno.ENOSPC))
    with pytest.raises(OutputError, match=r"a\.tif: cannot write the file: No space left on device"):
        write_picture(tmp_path / "a.tif", np.zeros((3, 4), np.uint8))
    assert not list(tmp_path.iterdir())
