"""Large pictures in bounded memory: ``python -m benchmarks.memory [--size 8000x6000] [--max-memory 1GiB]``.

Deblurs a generated RGB TIFF of 8 bits with the command line. Measures the private memory of the process (Linux:
RssAnon). Extra is that memory less that of the same command on a small picture; it contains the picture and its result.
``--mode global`` measures one mode.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile

from benchmarks import machine
from benchmarks.cases import EXPOSURE, NSR, READOUT, Case
from benchmarks.tables import print_table
from rsdeblur import Camera, GyroLog

MODES = {
    "global": ["--mode", "global", "--prior", "wiener"],
    "banded": ["--mode", "banded", "--prior", "wiener"],
    "rowwise": ["--mode", "rowwise", "--prior", "wiener"],
    "banded, tv": ["--mode", "banded", "--prior", "tv"],
}
BOX = 17, 59
SMALL = 320, 240
POLL = 0.02


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="8000x6000", help="width x height, px (8000x6000)")
    parser.add_argument("--max-memory", default="1GiB", help="the bound (1GiB)")
    parser.add_argument("--mode", choices=MODES, action="append", help="only these modes (all)")
    parser.add_argument("--folder", type=Path, help="folder for the pictures (the system's temporary folder)")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    rows, load = [], machine.load()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for name in options.mode or MODES:
            small, _, _ = run(Path(folder), SMALL, name, "1GiB")
            peak, seconds, output = run(Path(folder), (width, height), name, options.max_memory)
            extra = (peak - small) / 2**20
            rows.append([name, options.size, options.max_memory, f"{extra:.0f}", f"{seconds:.1f}", output])
    print_table(["mode", "size", "bound", "extra MiB", "seconds", "output"], rows)
    for note in machine.busy(load):
        print(note)


def run(folder: Path, size: tuple[int, int], mode: str, max_memory: str) -> tuple[int, float, str]:
    """Deblur a picture of `size`; return the peak memory of the process, bytes, the time, s, and its output."""
    camera, log = capture(folder, size)
    camera.save(folder / "camera.toml")
    samples = np.column_stack([log.t, log.omega])
    np.savetxt(folder / "gyro.csv", samples, delimiter=",", header="t,wx,wy,wz", comments="")
    recording = [
        "--start",
        str(EXPOSURE.start),
        "--duration",
        str(EXPOSURE.duration),
        "--nsr",
        str(NSR),
        "--unit",
        "rad/s",
    ]
    files = ["photo.tif", "--gyro", "gyro.csv", "--camera", "camera.toml", "-o", "sharp.tif", "--force"]
    command = [sys.executable, "-m", "rsdeblur", "deblur", *files, *recording, *MODES[mode], "--max-memory", max_memory]
    begin = time.perf_counter()
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        peak = _watch(process)
        output = process.stdout.read().strip() if process.stdout else ""
    first = output.partition("\n")[0].partition(": ")[2]
    return peak, time.perf_counter() - begin, first or f"refused, exit code {process.returncode}"


def capture(folder: Path, size: tuple[int, int]) -> tuple[Camera, GyroLog]:
    """Write photo.tif, made of small scenes side by side, and return the camera and the log."""
    case = Case(2048, 1536, BOX)
    tile = (255 * Case(512, 384, (9, 9)).sharp).astype(np.uint8)
    width, height = size
    wide = np.tile(tile, (1, -(-width // tile.shape[1]), 1))[:, :width]
    picture = tifffile.memmap(folder / "photo.tif", shape=(height, width, 3), dtype=np.uint8, photometric="rgb")
    for top in range(0, height, len(tile)):
        picture[top : top + len(tile)] = wide[: min(len(tile), height - top)]
    picture.flush()
    # Rates shrink so that the PSF keeps its size in px.
    log, slower = case.log(16), case.width / width
    return Camera(width, height, case.camera.focal_length[0] / slower, readout_time=READOUT), GyroLog(
        log.t, slower * log.omega
    )


def _watch(process: subprocess.Popen[str]) -> int:
    peak = 0
    while process.poll() is None:
        peak = max(peak, _anonymous(process.pid))
        time.sleep(POLL)
    return peak


def _anonymous(pid: int) -> int:
    try:
        lines: Sequence[str] = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("RssAnon")), 0)


if __name__ == "__main__":
    main()
