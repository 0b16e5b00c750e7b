"""Cost of the exact solve: ``python -m benchmarks.rowwise [--size 2048x1536] [--rounds 11] [--threads 2]``.

Times `RowDeconvolver.apply` (Wiener, one strip, RGB) against `Deconvolver.apply` of the global mode, in turns as in
`benchmarks.peers`, for PSFs 17, 31 and 77 rows tall (16, 31 and 76 rounded up: kernels have a centre pixel). In
addition, one thread solves one block of 16 frequencies, on all rows and on so few rows that the factor stays in the
cache. If both run at the same speed, arithmetic bounds the solve; otherwise memory does. For PSFs 31 rows tall
the hyper-Laplacian prior with all its steps is timed against the Wiener filter of the same
solver.

``--quick`` uses small pictures; its times mean nothing.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from benchmarks.cases import EXPOSURE, NSR, Case, size
from benchmarks.peers import QUICK_SIZE, SIZE
from benchmarks.tables import markdown, print_table, write
from benchmarks.timing import Job, Times, interleave, refuse_noise
from rsdeblur import Deconvolver
from rsdeblur.deconv import DerivativePrior, RowDeconvolver
from rsdeblur.deconv.rowwise_blur import StripBlur, latent_rows
from rsdeblur.kernels import rowwise
from rsdeblur.kernels.rowwise import BLOCK, LANES, RowModel
from rsdeblur.motion import BlurPaths, Capture

# Target for each height of the PSF in px: time of `apply`, in units of the global mode's `apply`.
TARGETS = {17: 3.0, 31: 6.0, 77: 25.0}
WIDTH = 17
# Number of bands for which the paths of a case just fill its box.
BANDS = 16
# Height of the PSF for which a sparse prior is timed, its target in units of the Wiener filter's `apply`, and the
# prior. The weight does not affect the time; it is close to the automatic one at 40 dB of noise.
SPARSE, SPARSE_TARGET = 31, 8.0
PRIOR = DerivativePrior("hyper-laplacian", weight=0.003, peak=1.0)
# Rows of the picture whose factor is to stay in the cache, in heights of the PSF.
FEW = 3
COLUMNS = ("PSF rows", "apply ms", "/ global", "at most", "met", "GFLOP/s", "in cache", "share of apply")
Record = dict[str, Any]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=size, help="width x height of the picture (2048x1536)")
    parser.add_argument("--rounds", type=int, help="rounds of timing (11)")
    parser.add_argument("--threads", type=int, default=2, help="threads of both modes (2)")
    parser.add_argument("--quick", action="store_true", help="small pictures and 3 rounds, to see that it runs")
    parser.add_argument("--json", type=Path, help="write the record")
    parser.add_argument("--markdown", type=Path, help="write the table")
    options = parser.parse_args()
    record = run(
        options.size or (QUICK_SIZE if options.quick else SIZE),
        options.rounds or (3 if options.quick else 11),
        options.threads,
        steady=not options.quick,
    )
    record["command"] = "python -m benchmarks.rowwise " + " ".join(sys.argv[1:])
    print_table(COLUMNS, rows(record))
    print(summary(record))
    if options.json:
        write(options.json, json.dumps(record, indent=1))
    if options.markdown:
        refuse_noise(record["load"], {name: Times(**each) for name, each in record["times"].items()})
        write(options.markdown, markdown(COLUMNS, rows(record)) + "\n\n" + summary(record))


def run(size: tuple[int, int], rounds: int, threads: int, *, steady: bool = False) -> Record:
    """Time everything and return the record."""
    record: Record = {"machine": machine.facts(), "load": machine.load(), "size": size, "threads": threads}
    case = Case(*size, (WIDTH, WIDTH))
    picture, out = case.blurred, np.empty(case.shape, dtype=np.float32)
    plain = Deconvolver(case.bank(1), case.shape, nsr=NSR, threads=threads)
    jobs: dict[tuple[str, int], Job] = {("global", 0): lambda: plain.apply(picture, out)}
    solvers, work = {}, {}
    for height in TARGETS:
        paths = row_paths(Case(*size, (WIDTH, height)))
        solvers[height] = solver = RowDeconvolver(paths, case.shape, nsr=NSR, threads=threads)
        jobs["apply", height] = lambda solver=solver: solver.apply(picture, out)  # type: ignore[misc]  # bound now
        few = BlurPaths(paths.displacements[: FEW * height], paths.rows[: FEW * height], paths.cols)
        for name, part in (("block", paths), ("cached", few)):
            jobs[name, height], work[name, height] = one_block(part, size[0])
    jobs["sparse", SPARSE] = lambda: solvers[SPARSE].apply(picture, out, prior=PRIOR)
    times = interleave(jobs, rounds, steady=steady)
    record["times"] = {f"{name}, PSF of {height} rows": asdict(each) for (name, height), each in times.items()}
    record["sparse_s"] = times["sparse", SPARSE].median
    record["sparse_ratio"] = times["sparse", SPARSE] / times["apply", SPARSE]
    record["global_s"] = times["global", 0].median
    record["heights"] = [
        {
            "height": height,
            "apply_s": times["apply", height].median,
            "ratio": times["apply", height] / times["global", 0],
            "bound": bound,
            "gflops": work["block", height] / times["block", height].median / 1e9,
            "cached_gflops": work["cached", height] / times["cached", height].median / 1e9,
            "share": times["block", height].median
            * solvers[height]._spectra.blocks
            / threads
            / times["apply", height].median,
        }
        for height, bound in TARGETS.items()
    ]
    return record


def row_paths(case: Case) -> BlurPaths:
    """Return the paths of every row of a case, in one strip."""
    recording = Capture.from_log(case.log(BANDS), case.camera, EXPOSURE)
    return BlurPaths.every_row(recording, [(case.width - 1) / 2])


def one_block(paths: BlurPaths, length: int) -> tuple[Job, float]:
    """Return a job that solves 16 frequencies on one thread, and its floating-point operations."""
    strip = StripBlur.from_frames([paths], [1.0], 0, *latent_rows(paths))
    workspace = np.empty(strip.workspace_size(solve=True), dtype=np.float32)
    table, penalty = strip.table(1, length), np.zeros((3, LANES), dtype=np.float32)
    penalty[0] = NSR
    data = np.ones((3, strip.rows, 2, LANES), dtype=np.float32)
    latent = np.zeros((3, strip.model.latents, 2, LANES), dtype=np.float32)
    return lambda: rowwise.solve(strip.model, table, data, latent, workspace, penalty), operations(strip.model, 3)


def operations(model: RowModel, channels: int) -> float:
    """Count the operations of a solve: assembly, factorisation and substitutions; a complex product counts as eight."""
    first, end, coupled = model.row_first, model.row_end, model.coupled
    products = 0
    for j, start in enumerate(coupled):
        i = np.arange(start, j + 1)
        overlap = np.minimum(end[j], end[i]) - np.maximum(first[j], first[i])
        behind = BLOCK * (i - np.maximum(start, coupled[i]))
        products += BLOCK**2 * int(np.maximum(overlap, 0).sum() + behind.sum())
        products += BLOCK * channels * int(end[j] - first[j] + 2 * BLOCK * (j - start))
    return 8.0 * LANES * products


def rows(record: Record) -> list[list[str]]:
    """Return the rows of the table."""
    return [
        [
            str(row["height"]),
            f"{row['apply_s'] * 1e3:.0f}",
            f"{row['ratio']:.2f}",
            f"{row['bound']:g}",
            "yes" if row["ratio"] <= row["bound"] else "no",
            f"{row['gflops']:.0f}",
            f"{row['cached_gflops']:.0f}",
            f"{row['share']:.0%}",
        ]
        for row in record["heights"]
    ]


def summary(record: Record) -> str:
    """Return the lines below the table: sizes, machine and the sparse prior."""
    width, height = record["size"]
    lines: Sequence[str] = (
        f"RGB {width}x{height}, {record['threads']} threads, {record['machine']['processor']}; "
        f"global apply {record['global_s'] * 1e3:.0f} ms. GFLOP/s of one thread on one block of 16 frequencies.",
        f"Hyper-Laplacian, {SPARSE} rows: {record['sparse_s'] * 1e3:.0f} ms, {record['sparse_ratio']:.2f} times its "
        f"Wiener filter (at most {SPARSE_TARGET:g}).",
        *machine.busy(record["load"]),
    )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
