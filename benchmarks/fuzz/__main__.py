"""Run the fuzzer: ``python -m benchmarks.fuzz [TARGET ...] [--count N] [--save FOLDER]``.

Every input follows from the name of its target and its number, so it can be made again: ``--only N`` writes it to
standard output. Each target runs in a separate process. After a crash it continues after the input that caused it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from multiprocessing import get_context
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any

from benchmarks.fuzz.targets import TARGETS
from rsdeblur.errors import LONGEST_MESSAGE, RsdeblurError

# Limit on the processor time of one input, s; after ENDLESS times that limit the input counts as endless.
SLOW, ENDLESS = 2.0, 10
# Address space of the process, bytes; beyond it the process gets MemoryError.
MEMORY = 4 * 2**30

# Indices of the numbers that the process shares with its parent.
DONE, READ, SLOWEST, SLOWEST_AT, PEAK, PEAK_AT, PEAK_SIZE = range(7)


def hostile(name: str, number: int) -> bytes:
    """Return input `number` of a target."""
    return TARGETS[name].spoilt(random.Random(f"{name} {number}"))


def _work(name: str, numbers: range, shared: Any, findings: Path) -> None:
    """Read inputs and write violations to the file `findings`, one line of JSON each."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    # Native code prints messages about the files.
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    warnings.simplefilter("ignore")
    warnings.filterwarnings("error", category=RuntimeWarning, module="rsdeblur")
    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as folder, findings.open("a") as log:
        path = Path(folder) / target.name
        base = None
        for number in numbers:
            data = target.spoilt(random.Random(f"{name} {number}"))
            path.write_bytes(data)
            signal.setitimer(signal.ITIMER_PROF, SLOW * ENDLESS)
            begin = time.process_time()
            problem = ""
            try:
                target.read(path)
                shared[READ] += 1
            except RsdeblurError as error:
                if folder not in str(error):
                    problem = f"the message does not name the file: {error}"
                if len(str(error)) > LONGEST_MESSAGE + len("..."):
                    problem = f"the message has {len(str(error))} characters"
            except Exception as error:
                where = "".join(traceback.format_tb(error.__traceback__)[-3:])
                problem = f"{type(error).__name__}: {str(error)[:300]}\n{where}"
            signal.setitimer(signal.ITIMER_PROF, 0)
            seconds = time.process_time() - begin
            if seconds > shared[SLOWEST]:
                shared[SLOWEST], shared[SLOWEST_AT] = seconds, number
            if seconds > SLOW:
                problem = problem or f"slow: {seconds:.1f} s"
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            # The first inputs load modules and fill caches, so they set the base.
            if base is None or number < numbers.start + 50:
                base = shared[PEAK] = peak
            elif peak > shared[PEAK]:
                shared[PEAK], shared[PEAK_AT], shared[PEAK_SIZE] = peak, number, len(data)
            if problem:
                log.write(json.dumps({"target": name, "number": number, "problem": problem}) + "\n")
                log.flush()
            shared[DONE] = number + 1


def run(name: str, count: int, findings: Path) -> dict[str, Any]:
    """Fuzz one target and return the record."""
    shared: Any = RawArray("d", 7)
    crashes, begin = 0, time.monotonic()
    while shared[DONE] < count:
        process = get_context("fork").Process(
            target=_work, args=(name, range(int(shared[DONE]), count), shared, findings)
        )
        process.start()
        process.join()
        if process.exitcode == 0:
            break
        if process.exitcode is not None and process.exitcode > 0:
            raise SystemExit(f"{name}: the fuzzer itself failed, exit code {process.exitcode}")
        crashes += 1
        killed = signal.Signals(-(process.exitcode or 0)).name
        problem = "endless" if killed == "SIGPROF" else f"the process died of {killed}"
        with findings.open("a") as log:
            log.write(json.dumps({"target": name, "number": int(shared[DONE]), "problem": problem}) + "\n")
        shared[DONE] += 1
        if crashes > 200:
            break
    return {
        "target": name,
        "reader": TARGETS[name].reader,
        "inputs": int(shared[DONE]),
        "read": int(shared[READ]),
        "slowest_s": round(shared[SLOWEST], 3),
        "slowest_input": int(shared[SLOWEST_AT]),
        "peak_mib": round(shared[PEAK]),
        "peak_input": int(shared[PEAK_AT]),
        "peak_file_bytes": int(shared[PEAK_SIZE]),
        "problems": sum(1 for finding in _findings(findings) if finding["target"] == name),
        "seconds": round(time.monotonic() - begin),
    }


def _findings(findings: Path) -> Iterator[dict[str, Any]]:
    if findings.exists():
        yield from map(json.loads, findings.read_text().splitlines())


def _row(record: dict[str, Any]) -> str:
    return (
        f"{record['target']:20} {record['inputs']:>8} {record['read']:>8} {record['slowest_s']:>8.3f} "
        f"{record['peak_mib']:>6} {record['problems']:>5} {record['seconds']:>6}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the fuzzer; return 1 if there was a violation."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"any of {', '.join(TARGETS)}; default all")
    parser.add_argument("--count", type=int, default=1000, help="inputs of each reader, shared by its targets")
    parser.add_argument("--only", type=int, metavar="N", help="write input N of the one target and stop")
    parser.add_argument("--save", type=Path, default=Path("fuzz-findings"), help="folder for violations and figures")
    options = parser.parse_args(arguments)
    if options.only is not None:
        sys.stdout.buffer.write(hostile(options.targets[0], options.only))
        return 0
    options.save.mkdir(parents=True, exist_ok=True)
    print(f"{'target':20} {'inputs':>8} {'read':>8} {'slowest':>8} {'MiB':>6} {'broke':>5} {'s':>6}", flush=True)
    problems = 0
    shares = Counter(target.reader for target in TARGETS.values())
    for name in options.targets or TARGETS:
        findings = options.save / f"{name}.jsonl"
        findings.unlink(missing_ok=True)
        record = run(name, -(-options.count // shares[TARGETS[name].reader]), findings)
        (options.save / f"{name}.json").write_text(json.dumps(record, indent=2) + "\n")
        problems += record["problems"]
        print(_row(record), flush=True)
    return min(problems, 1)


if __name__ == "__main__":
    sys.exit(main())
