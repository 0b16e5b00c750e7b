"""A short run of some benchmarks without recordings: ``python -m benchmarks.smoke``."""

from __future__ import annotations

import os
import subprocess
import sys

from benchmarks import peers, rowwise

# Commands that pages print.
COMMANDS = (
    "quality --quick",
    "priors --quick",
    "verdict --quick",
    "tiles --quick",
)


def main() -> None:
    """Run each benchmark on small pictures. Exit with 1 if an alternative returns another picture than rsdeblur."""
    for command in COMMANDS:
        print(f"\npython -m benchmarks.{command}", flush=True)
        words = [sys.executable, "-m", *f"benchmarks.{command}".split()]
        subprocess.run(words, check=True, env=os.environ | {"RSDEBLUR_DATA": os.devnull})
    print(rowwise.summary(rowwise.run(peers.QUICK_SIZE, 1, 1)))
    beside = peers.run(peers.QUICK_SIZE, peers.QUICK_LARGE, 1, [1])
    print(peers.as_markdown(beside))
    peers.refuse_other_pictures(beside)


if __name__ == "__main__":
    main()
