"""`rsdeblur batch`: deblur many photos in worker processes."""

import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import file_state, read_file
from rsdeblur.choices import BATCH, SHARP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options, _output
from rsdeblur.cli._items import COLUMNS, Item, read_items
from rsdeblur.cli._options import FILES, FOLDER, Command, Recording, Target, shared_threads
from rsdeblur.cli._photo import PhotoJob, deblur_photo
from rsdeblur.cli._types import PATH
from rsdeblur.errors import InputError, OutputError, RsdeblurError
from rsdeblur.pipeline.options import Options

HELP = f"""Deblur many photos.

They are those of a MANIFEST, of a logger's FOLDER, or several PHOTOs. One that fails does not stop the others.

MANIFEST is a CSV file with a line for each photo. Its first line names the columns: photo, and if needed
{", ".join(name for name in COLUMNS if name != "photo")}. They mean what the options of `deblur` mean; empty cells take
the options given here. FOLDER is a session of MARS logger, OpenCamera Sensors or Sensor Logger that contains photos or
frames. A ZIP of it is unpacked below DIR. PHOTOs share the log and the camera; their exposures come from EXIF, with
--start exif, or from --capture, by the timestamps or frame numbers in their names.

A second run skips the photos that are done, which batch.json beside the results lists. Exit code 3: some photos failed.
"""
EXAMPLES = """\b
Examples:
  rsdeblur batch manifest.csv --gyro gyro.csv --camera phone.toml --capture frames.csv
  rsdeblur batch mars_session/ --camera phone.toml -o sharp --dry-run
  rsdeblur batch a.jpg b.jpg --gyro Gyroscope.csv --camera phone.toml --start exif -o sharp
"""


@click.command("batch", cls=Command, help=HELP, epilog=EXAMPLES)
@click.argument("sources", type=PATH, metavar="MANIFEST|FOLDER|ZIP|PHOTO...", nargs=-1, required=True)
@_options.recording_options(*(name for name in FOLDER if name != "start_ns"), required=())
@_options.solve_options(*(name for name in _options.SOLVE if name != "refine"))
@_options.refine_option
@_options.jobs_option("processes", "half the number of cores")
@_options.target_options(
    "DIR",
    "Folder to write to; by default MANIFEST-sharp or FOLDER-sharp beside it. PHOTOs have that of the first one's "
    "folder.",
    default=lambda sources, **_: _options.beside(sources[0] if len(sources) == 1 else sources[0].parent, SHARP),
    dry_run=True,
)
def command(**arguments: Any) -> None:
    """Deblur many photos."""
    run(**arguments)


def run(
    sources: tuple[Path, ...],
    recording: Recording,
    options: Options,
    refine: bool | None,
    target: Target,
    jobs: int | None = None,
) -> None:
    """Deblur the photos of a manifest or of a folder, or several, and write and print their table."""
    options = _options.with_refinement(options, refine)
    items = read_items(sources, recording, target.output, unpack=not target.dry_run)
    if not items:
        raise InputError(f"{sources[0]}: there is nothing to do, because no photo is listed")
    jobs, threads = shared_threads(jobs, options.threads)
    earlier = _earlier(target.output / BATCH)
    _output.prepare_folder(target.output, [BATCH], force=target.force or earlier is not None, dry_run=target.dry_run)
    begin = time.perf_counter()
    entries = _deblurred(items, replace(options, threads=threads), bool(refine), target, earlier or {}, jobs)
    summary = _summary(entries) | {"seconds": time.perf_counter() - begin}
    if target.as_json:
        _output.print_json(summary)
    else:
        _print(summary, target)
    errors = [entry["error"] for entry in entries if "error" in entry]
    for error in errors:
        _output.say_aside(f"error: {error}")
    if errors:
        click.get_current_context().exit(3)


def _earlier(path: Path) -> dict[str, Any] | None:
    """Return the entries of an earlier run by their outputs; None if there is no list, or another program's."""
    try:
        found = json.loads(read_file(path, "list of results"))["items"]
        return {entry["output"]: entry for entry in found if "output" in entry}
    except (ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return None


def _deblurred(
    items: list[Item], options: Options, refine_anyway: bool, target: Target, earlier: dict[str, Any], jobs: int
) -> list[dict[str, Any]]:
    """Deblur the photos that are not done yet, and return what is known about each; the finished ones have a state."""
    entries: list[dict[str, Any]] = [{"photo": str(item.photo)} for item in items]
    tasks: list[tuple[int, PhotoJob, bool]] = []
    for i, (item, entry) in enumerate(zip(items, entries, strict=True)):
        with _as_row(entry):
            if item.recording is None or item.error is not None:
                raise InputError(item.error or "no recording")
            job = PhotoJob(
                photo=item.photo,
                recording=item.recording,
                target=replace(target, output=target.output / item.output),
                make_folder=True,
                options=options,
                refine_anyway=refine_anyway,
            )
            if not _is_done(job, entry, earlier.get(str(job.target.output), {})):
                # The first worker speaks for all.
                tasks.append((i, job, not tasks and _output.level() >= 0))
    if tasks:
        _write(target, entries)
    try:
        with _output.progress("batch") as move, closing(rs.run(work, iter(tasks), jobs=jobs)) as answers:
            for (i, job, _), answer in answers:
                with _as_row(entries[i]):
                    if isinstance(answer, rs.Failure):
                        raise InputError(answer.message)
                    for message in answer.pop("warnings"):
                        _output.warn(message if str(job.photo) in message else f"{job.photo}: {message}")
                    state = "checked" if target.dry_run else "done"
                    entries[i] |= answer | {"state": state, "recipe": _recipe(job)}
                finished = sum("state" in entry for entry in entries)
                move(f"{finished} of {len(entries)}", finished / len(entries))
    finally:
        _write(target, entries)
    return entries


def _is_done(job: PhotoJob, entry: dict[str, Any], earlier: dict[str, Any]) -> bool:
    """Return whether the result is that of an earlier run; raise `OutputError` if it has another recipe."""
    recipe, recorded, output = _recipe(job), earlier.get("recipe"), job.target.output
    exists = output.exists()
    entry["output"] = str(output)
    if not (exists and recorded) or job.target.force:
        if not exists:
            entry["recipe"] = recipe
        return False
    # The next list has the results that this run leaves as they are.
    entry |= earlier
    entry.pop("error", None)
    if recorded != recipe:
        raise OutputError(
            f"{output}: the file exists; use force (--force) to replace it, or another folder: it was made with "
            "other options or from other files, or these have another date"
        )
    entry["state"] = "skipped"
    return True


def _summary(entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the finished entries, and how many there are of each state and verdict."""
    finished = [entry for entry in entries if "state" in entry]
    verdicts = Counter(filter(None, map(_verdict, finished)))
    return {"items": finished, "counts": Counter(entry["state"] for entry in finished), "verdicts": verdicts}


def _write(target: Target, entries: list[dict[str, Any]]) -> None:
    """Write the list of results, of those under way too: each is written as a whole, or not at all."""
    if not target.dry_run:
        _output.write_json(target.output / BATCH, _summary(entries) | {"items": entries})


@contextmanager
def _as_row(entry: dict[str, Any]) -> Iterator[None]:
    """Turn an error into the state of its row: whatever fails, the other photos are deblurred."""
    try:
        yield
    except (RsdeblurError, OSError, ValueError) as error:
        entry |= {"state": "failed", "error": _output.reason(error, entry["photo"])}


def work(task: tuple[int, PhotoJob, bool]) -> dict[str, Any]:
    """Deblur one photo, in a worker, which may say that it compiles."""
    _, job, may_say = task
    says = _output.compiling() if may_say else nullcontext()
    with says, _output.capture_warnings(show=False) as messages, _output.usage_as_input_error():
        return deblur_photo(job) | {"warnings": messages}


def _recipe(job: PhotoJob) -> str:
    """Return a text that changes with settings and files, by name, size and date: a folder may be moved."""
    # Any number of threads gives the same bits.
    settings = [replace(job.options, threads=None), job.refine_anyway]
    settings += [value for key, value in asdict(job.recording).items() if key not in FILES]
    files = [job.photo, *(getattr(job.recording, key) for key in FILES)]
    text = repr((settings, [path and (path.name, *(file_state(path) or ())[2:]) for path in files]))
    return hashlib.sha256(text.encode()).hexdigest()


def _verdict(entry: dict[str, Any]) -> str:
    """Return the verdict on a result, empty if there is none; a photo that failed may have an earlier one."""
    return "" if "error" in entry else (entry.get("check") or {}).get("verdict", "")


def _print(summary: dict[str, Any], target: Target) -> None:
    rows = []
    for entry in summary["items"]:
        # A photo that failed may have an earlier result.
        known = {"photo": entry["photo"], "state": entry["state"]} if "error" in entry else entry
        tiles = f"{known['bands']} x {known['strips']}" if "bands" in known else ""
        size = "{} x {}".format(*known["psf_px"]) if "psf_px" in known else ""
        seconds = f"{known['seconds']:.2f}" if "seconds" in known else ""
        rows.append([known["photo"], known["state"], tiles, size, seconds, _verdict(known)])
    _output.print_table(["photo", "state", "bands x strips", "PSF px", "time s", "check"], rows)
    counts = ", ".join(f"{count} {state}" for state, count in summary["counts"].items())
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(summary["verdicts"].items()))
    place = "" if target.dry_run else f"; see {target.output}"
    _output.say(f"{counts}{f' ({verdicts})' if verdicts else ''}; {summary['seconds']:.1f} s{place}")
