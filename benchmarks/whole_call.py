"""What users call: ``python -m benchmarks.whole_call [--rounds 3] [--markdown FILE]``.

Times of `rsdeblur.deblur` of an 8-bit picture with a quality: strengths, tiles, PSFs, solve, check and conversions
included. The unit is the bare 7 FFTs of that size (:func:`benchmarks.alternatives.bare`). Calls and FFTs are measured
in turns.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from benchmarks import machine
from benchmarks.alternatives import bare
from benchmarks.cases import Case, burst_of
from benchmarks.tables import markdown, report
from benchmarks.timing import interleave, refuse_noise
from rsdeblur import deblur
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import Quality

# Megapixels, and the strength of the shake that makes PSFs of some 50 x 65 px.
SIZES = {3: 0.55, 12: 0.27}
# Tiles with the published filter, the default (tiles here, by its motion), and rows.
TIMED: tuple[Quality, ...] = ("fast", "balanced", "best")


def rows(megapixels: int, rounds: int, load: float) -> list[tuple[str, ...]]:
    """Measure one size; `load` is that of the machine before."""
    (photo,), log, camera, (exposure,) = burst_of(megapixels, 1, strength=SIZES[megapixels])
    results = {quality: deblur(photo, log, camera, exposure, quality=quality) for quality in TIMED}
    tall, wide = results["balanced"].psfs.size
    jobs = {quality: partial(deblur, photo, log, camera, exposure, quality=quality) for quality in results} | {
        "bare": bare(Case(camera.width, camera.height, (wide, tall)), thread_count(None)).run
    }
    times = interleave(jobs, rounds, steady=True)
    refuse_noise(load, times)
    return [
        (
            f"{camera.width}x{camera.height}, PSFs of {wide}x{tall} px, {quality}",
            f"{result.bands} x {result.strips}",
            f"{times[quality].median:.2f}",
            f"{times[quality] / times['bare']:.1f}",
        )
        for quality, result in results.items()
    ]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="times that each call is measured (3)")
    parser.add_argument(
        "--megapixels", type=int, choices=SIZES, nargs="+", default=list(SIZES), help="only these sizes"
    )
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    load = machine.load()
    table = [row for size in options.megapixels for row in rows(size, options.rounds, load)]
    text = markdown(("picture and quality", "bands x strips", "s", "/ bare FFTs"), table)
    report(text, options.markdown)


if __name__ == "__main__":
    main()
