"""Follow every tutorial as a newcomer would: ``python -m benchmarks.tutorials [--only TEXT] [--outputs]``.

Each page starts in an empty folder, and its commands and Python blocks run as they are printed, in order, with the
installed program. A command must succeed, unless the output printed below its block ends in an error.

A block that cannot run everywhere is left out and counted: its first line is the comment ``# Needs ...``, or it uses an
environment variable that is not set. All of it takes about 10 minutes on two slow cores; `tests/test_docs.py` follows
the short pages on smaller pictures. ``--outputs`` also prints what commands print whose output a page shows, to compare
and renew it.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from textwrap import indent
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
# Beside the pages of the folder `tutorials`, this one is to be followed too.
PAGES = (DOCS / "good-data.md", *sorted((DOCS / "tutorials").glob("*.md")))
BLOCK = re.compile(r"^ *```(\w+)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
# Limit of one command, s; a busy machine takes ten times as long as an idle one.
PATIENCE = 3600


class Step(NamedTuple):
    """A command or a Python block of a page."""

    language: str
    text: str
    needs: str = ""
    """What the page says it needs, which not every machine has."""
    is_shown: bool = False
    """Whether the page shows the output of its block."""
    is_refused: bool = False
    """Whether the page shows that it ends in an error."""


class Outcome(NamedTuple):
    """Why a step was left out or failed, both empty if it succeeded, its time in s, and what it printed."""

    skipped: str = ""
    failed: str = ""
    seconds: float = 0.0
    printed: str = ""


def steps(page: Path) -> Iterator[Step]:
    """Yield the commands and Python blocks of a page, in order."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    for (language, content), (following, output) in pairwise([*blocks, ("", "")]):
        needs = re.match(r" *# Needs (.*)\n", content)
        is_shown = following == "text"
        is_refused = is_shown and "rsdeblur: error:" in output
        parts = [content]
        if language == "sh":
            parts = [part.strip() for part in re.findall(r"^(?! *#)((?:.*\\\n)*.+)$", content, re.MULTILINE)]
        elif language != "python":
            continue
        for part in parts:
            yield Step(language, part, needs[1] if needs else "", is_shown, is_refused)


def follow(step: Step, folder: Path, environment: Mapping[str, str]) -> Outcome:
    """Run a step in `folder`."""
    unset = [name for name in re.findall(r"\$([A-Z_]+)", step.text) if name not in environment]
    if step.needs or unset:
        return Outcome(skipped=step.needs or f"${unset[0]} is not set")
    begin, printed = time.perf_counter(), ""
    words = ["bash", "-c", step.text] if step.language == "sh" else [sys.executable, "-P", "-c", step.text]
    if step.text.split()[:2] == ["rsdeblur", "app"]:
        problem = _open_app(step.text, folder, environment)
    else:
        try:
            run = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            return Outcome(failed=f"no end after {PATIENCE} s", seconds=PATIENCE)
        printed = run.stdout
        problem = f"exit code {run.returncode}\n{run.stderr}" if (run.returncode != 0) != step.is_refused else ""
    return Outcome(failed=problem, seconds=time.perf_counter() - begin, printed=printed)


def _open_app(command: str, folder: Path, environment: Mapping[str, str]) -> str:
    """Start the app, request its page, and end it by Ctrl-C; return what went wrong."""
    # Without a shell, the program itself gets the signal.
    words = ["bash", "-c", f"exec {command}"]
    with subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as app:
        try:
            address = app.stdout.readline().strip() if app.stdout else ""
            with urllib.request.urlopen(address, timeout=30) as answer:
                page = answer.read()
            app.send_signal(signal.SIGINT)
            code = app.wait(30)
        except (OSError, ValueError, subprocess.TimeoutExpired) as error:
            return f"the page did not open: {error}"
        finally:
            app.kill()
    return "" if code == 0 and b"<html" in page else f"exit code {code}"


def surroundings(home: Path) -> dict[str, str]:
    """Return the environment of a newcomer who has activated this environment: no settings, no browser that opens."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    kept = {name: os.environ[name] for name in ("RSDEBLUR_DATA", "LANG", "LD_LIBRARY_PATH") if name in os.environ}
    return kept | {"PATH": path, "HOME": str(home), "BROWSER": "true", "RSDEBLUR_SOURCE": str(ROOT)}


def main() -> None:
    """Follow the pages, and exit with 1 if a step failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="TEXT", default="", help="only pages whose name contains TEXT")
    parser.add_argument("--outputs", action="store_true", help="print the outputs that the pages show")
    options = parser.parse_args()
    # A shell's background jobs ignore Ctrl-C, and the app would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    counts = {"done": 0, "left out": 0, "failed": 0}
    for page in (page for page in PAGES if options.only in page.stem):
        print(f"\n{page.relative_to(ROOT)}")
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as home:
            for step in steps(page):
                outcome = follow(step, Path(folder), surroundings(Path(home)))
                state = "failed" if outcome.failed else "left out" if outcome.skipped else "done"
                counts[state] += 1
                why = f" ({outcome.skipped})" if outcome.skipped else ""
                shown = " ".join(step.text.replace("\\\n", " ").split())
                print(f"  {state:8} {outcome.seconds:6.1f} s  {shown[:100]}{why}", flush=True)
                if options.outputs and step.is_shown:
                    print(indent(outcome.printed, "    "))
                if outcome.failed:
                    print(outcome.failed)
    print("\n" + ", ".join(f"{number} {state}" for state, number in counts.items()))
    sys.exit(counts["failed"] > 0)


if __name__ == "__main__":
    main()
