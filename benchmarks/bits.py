"""Bits of results of three generated pictures, with C and with NumPy: ``python -m benchmarks.bits``.

Prints the table of docs/developer/reliability.md, which `tests/benchmarks/test_bits.py` compares with the results of
the machine that it runs on. A digest covers every bit of a result, which depends on the processor, because FFTW and
Numba take other instructions on others. The sums hold everywhere: each is that of all values of a result, with random
signs, over the root of their number, so that it is of the order of their standard deviation, and no change of the
picture leaves all of them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rsdeblur as rs
from benchmarks import machine
from rsdeblur.choices import Mode, Prior, ReadoutDirection, Strength
from rsdeblur.kernels import native

ROOT = Path(__file__).resolve().parents[1]
PATHS = ("C", "NumPy")
SUMS = 3
# C and NumPy differ by up to 1e-6, and so do processors; a wrong filter or tap changes some sum by 1e-2.
TOLERANCE = 2e-5


class Result(NamedTuple):
    """Name, first 16 digits of the SHA-256, and sums of a result."""

    name: str
    digest: str
    sums: tuple[float, ...]


def results(threads: int = 2) -> list[Result]:
    """Deblur the pictures with the kernels that this process uses."""
    rng = np.random.default_rng(0)
    blocks = np.kron(rng.integers(0, 256, (12, 16, 3)), np.ones((8, 8, 1), np.int64))
    log = rs.hand_shake(0.3, strength=0.7, seed=1)
    found = []
    mode: Mode
    prior: Prior
    direction: ReadoutDirection
    for name, picture, direction, mode, prior in (
        ("8 bits, colour; global, Wiener", blocks.astype(np.uint8), "top-down", "global", "wiener"),
        (
            "16 bits, grey, read sideways; banded, tv",
            (257 * blocks[..., 0]).astype(np.uint16),
            "left-right",
            "banded",
            "tv",
        ),
        (
            "float, colour; rowwise, hyper-Laplacian",
            (blocks / 255).astype(np.float32),
            "top-down",
            "rowwise",
            "hyper-laplacian",
        ),
    ):
        camera = rs.Camera(128, 96, 150.0, readout_time=0.03, readout_direction=direction)
        weight: Strength = "auto" if prior == "wiener" else 0.01
        options = rs.Options(mode=mode, prior=prior, nsr=0.01, weight=weight, strips=2, threads=threads)
        image = rs.plan(log, camera, rs.Exposure(0.1, 0.04), options).apply(picture).image
        signs = np.random.default_rng(1).choice([-1.0, 1.0], (SUMS, image.size))
        sums = signs @ image.ravel().astype(np.float64) / image.size**0.5
        digest = hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest()[:16]
        found.append(Result(name, digest, tuple(sums.round(6).tolist())))
    return found


def of_path(path: str) -> list[Result]:
    """Return the results of a new process that uses C, or NumPy."""
    environment = {**os.environ, "RSDEBLUR_PURE": str(int(path == "NumPy"))}
    command = [sys.executable, "-m", "benchmarks.bits", "--json"]
    run = subprocess.run(
        command, env={**environment, "PYTHONSAFEPATH": ""}, cwd=ROOT, check=True, capture_output=True, text=True
    )
    return [Result(name, digest, tuple(sums)) for name, digest, sums in json.loads(run.stdout)]


def recorded_on() -> str:
    """Return a line that names what the digests depend on."""
    known = machine.facts()
    libraries = ", ".join(f"{name} {known[name]}" for name in ("numpy", "scipy", "numba", "pyfftw"))
    return f"Recorded on {known['processor']} ({known['simd']}, {_features()}), {known['system']}, with {libraries}."


def _features() -> str:
    """Return a short name for all features of the processor: processors of one name differ."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "features unknown"
    features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"features {hashlib.sha256(features.encode()).hexdigest()[:8]}"


def row(path: str, result: Result) -> str:
    """Return a row of the table."""
    return f"| {result.name} | {path} | `{result.digest}` | {' | '.join(f'{value:.6f}' for value in result.sums)} |"


def main() -> None:
    """Print the table, or the results of this process."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", action="store_true", help="print the results of this process only")
    if parser.parse_args().json:
        print(json.dumps(results()))
        return
    print(recorded_on(), end="\n\n")
    print("| picture; mode, prior | kernels | digest | sum 1 | sum 2 | sum 3 |")
    print("|---|---|---|---|---|---|")
    for path in PATHS if native else PATHS[1:]:
        for result in of_path(path):
            print(row(path, result))


if __name__ == "__main__":
    main()
