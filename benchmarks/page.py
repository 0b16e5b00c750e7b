"""Write docs/benchmarks/speed.md from the records: ``python -m benchmarks.page``.

Figures of a busy machine are not published, nor are times whose quartiles are more than 15 % of the median apart. The
records come from, on an idle machine::

    python -m benchmarks.peers --json docs/benchmarks/peers.json
    python -m benchmarks.growth --json docs/benchmarks/growth.json --plots docs/benchmarks
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks import growth, machine, peers
from benchmarks.data import ROOT
from benchmarks.peers import Record
from benchmarks.tables import markdown
from benchmarks.timing import refuse_noise

INTRODUCTION = """\
# Speed and memory

Made by `python -m benchmarks.page` from `peers.json` and `growth.json` beside it; do not edit. The commands that made
those:

```sh
{commands}
```

Compare ratios, not milliseconds. One process on one machine timed all rows of a table in turns, in a new random order
for every round. A measurement is the fastest call of half a second in which the host of a virtual machine took no
processor away. Rounds went on until the last ones agreed, six times as long at most; without agreement, those in
sequence that took the least time count. A time whose quartiles are still more than 15 % of the median apart is left
out, with its ratios: "-". Other machines have other ratios; run the commands to see yours.

## Compared with other libraries

All get the same blurred picture and PSFs, the paths of a shaken hand scaled to fill 17x59 and 73x77 px (width x height;
16x59 and 72x76 of Sindelar and Sroubek 2013, rounded up to odd sizes). The alternatives:

- **bare 7 FFTs**: FFTW's 2-D real transforms of the padded size, planned by pyFFTW (`FFTW_MEASURE`), one for the PSF
  and two per channel. No filter, no border, no copies. They pass over the whole picture in each direction; ours
  transforms lines in blocks that stay in the cache, so it can take less.
- **ours**: all of `Deconvolver.apply` into a given array: checks, border, transforms, filters, blending. *Periodic*
  omits the border.
- **SciPy FFT, MKL-FFT, OpenCV**: a Wiener filter with the real transforms of that library. The filter is made
  beforehand and the picture is assumed to repeat, which is less work than ours.
- **scikit-image**: `restoration.wiener` per channel, which makes its filter in each call. *As is*: with its own
  regulariser, the Laplacian, in one thread. Otherwise with our regulariser as a finished OTF and with a
  multithreaded FFT: the least work with which it gives our picture.
- **regularizepsf**: its patch transform per channel, patches of 256 px that overlap by half; "built in" is the time to
  construct it. It chooses its own number of threads.
- **motion + PSFs (+ filters)**: from the raw gyro log to the PSFs (and the filters) of 16 bands and 1 strip, with known
  FFT plans.

"Differs by" is the largest difference from *ours, global, periodic* over the whole picture; white is 1. Where border or
tiles differ, it is the rms difference over the inner half: of *ours, global* from *periodic*, and of regularizepsf from
*ours, 16 bands*.
"""

GROWTH = """\
## Growth

Each point is measured in a separate process with `threads={threads}`, twice, minutes apart; the faster counts. Extra
memory is the peak of the process while it planned and applied, less the pictures in and out.
"""


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--folder", type=Path, default=ROOT / "docs" / "benchmarks", help="folder of records, plots and page"
    )
    folder = parser.parse_args().folder
    beside, grown = (json.loads((folder / name).read_text()) for name in ("peers.json", "growth.json"))
    refuse_noise(max(beside["load"], grown["load"]))
    target = folder / "speed.md"
    target.write_text(page(beside, grown))
    print(f"wrote {target}")


def page(beside: Record, grown: Record) -> str:
    """Return the page for a record of each benchmark."""
    curves: list[str] = []
    for series, plot in zip(grown["series"], growth.plot_names(grown), strict=True):
        table = markdown(growth.columns(series), growth.rows(series))
        curves.append(f"### Over {series['label']}\n\n![time and extra memory]({plot})\n\n{table}")
    facts = markdown(("machine", "fact"), ((name, fact) for name, fact in beside["machine"].items()))
    introduction = INTRODUCTION.format(commands="\n".join((beside["command"], grown["command"])))
    parts = [
        introduction.rstrip(),
        facts,
        peers.as_markdown(peers.steady_figures(beside)),
        GROWTH.format(**grown).rstrip(),
        *machine.busy(grown["load"]),
        *curves,
    ]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    main()
