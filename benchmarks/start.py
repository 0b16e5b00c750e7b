"""Start-up time of the command line: ``python -m benchmarks.start [--rounds 5]``.

Each measurement is a whole process on a generated JPEG of 2 megapixels. Warm: compiled kernels and FFT plans are on
disk. Cold: neither is, as in the first run on a machine. Figures are medians over rounds that alternate between the
commands.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import machine
from benchmarks.cases import EXPOSURE, Case
from benchmarks.tables import print_table
from benchmarks.timing import Times, interleave, refuse_noise
from rsdeblur.io import write_picture

SIZE = 1632, 1224
BOX = 17, 51
QUICK = 160, 120
MODES = {
    "Wiener": ["--quality", "fast"],
    "default": [],
    "default, not refined": ["--no-refine"],
    "rowwise, Wiener": ["--mode", "rowwise", "--quality", "fast"],
}


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="times that each command is run (5)")
    parser.add_argument("--quick", action="store_true", help="a small picture, once, to see that it runs")
    options = parser.parse_args()
    load = machine.load()
    with tempfile.TemporaryDirectory() as folder:
        times = run(Path(folder), QUICK if options.quick else SIZE, 1 if options.quick else options.rounds)
    if not options.quick:
        refuse_noise(load, {f"{name}, {'cold' if cold else 'warm'}": each for (name, cold), each in times.items()})
    names = dict.fromkeys(name for name, _ in times)
    rows = [[name, *(f"{times[name, cold].median:.2f}" for cold in (False, True))] for name in names]
    print_table(["command", "warm s", "cold s"], rows)


def run(folder: Path, size: tuple[int, int], rounds: int) -> dict[tuple[str, bool], Times]:
    """Return the times of each command, warm and cold."""
    case = Case(*size, BOX)
    write_picture(folder / "photo.jpg", case.blurred)
    case.camera.save(folder / "camera.toml")
    log = case.log(1)
    np.savetxt(
        folder / "gyro.csv", np.column_stack([log.t, log.omega]), delimiter=",", header="t,wx,wy,wz", comments=""
    )
    files = ["photo.jpg", "--gyro", "gyro.csv", "--unit", "rad/s", "--camera", "camera.toml"]
    exposure = ["--start", str(EXPOSURE.start), "--duration", str(EXPOSURE.duration)]
    deblur = ["deblur", *files, *exposure, "-o", "out.jpg", "--force"]
    commands = {"--help": ["--help"]} | {f"deblur, {name}": [*deblur, *more] for name, more in MODES.items()}

    def start(name: str, cold: bool) -> None:
        with tempfile.TemporaryDirectory(dir=folder) as fresh:
            cache = fresh if cold else str(folder)
            command = [sys.executable, "-m", "rsdeblur", *commands[name]]
            places = {"XDG_CACHE_HOME": cache, "NUMBA_CACHE_DIR": cache}
            subprocess.run(command, cwd=folder, env=os.environ | places, stdout=subprocess.DEVNULL, check=True)

    # The first round, which is not counted, fills the caches.
    jobs = {(name, cold): partial(start, name, cold) for name in commands for cold in (False, True)}
    return interleave(jobs, rounds, steady=rounds > 1)


if __name__ == "__main__":
    main()
