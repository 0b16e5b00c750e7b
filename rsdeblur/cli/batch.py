"""`rsdeblur batch`: deblur many photos in worker processes."""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.atomic import remove_unfinished
from rsdeblur._util.files import read_file
from rsdeblur.choices import BATCH, SHARP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._items import COLUMNS, Item, read_items
from rsdeblur.cli._options import FILES, SERIES, Command, Recording, Target, option, shared_threads
from rsdeblur.cli._output import (
    capture_warnings,
    file_state,
    prepare_folder,
    print_json,
    print_table,
    progress,
    reason,
    say,
    say_aside,
    usage_as_input_error,
    warn,
    write_json,
    write_table,
)
from rsdeblur.cli._photo import PhotoJob, deblur_photo
from rsdeblur.cli._types import PATH
from rsdeblur.errors import InputError, OutputError, RsdeblurError
from rsdeblur.pipeline.options import COMPUTING, Options

TABLE = "batch.csv"
SOME_FAILED = 3  # exit code
COLUMNS_OF_TABLE = (
    *("photo", "output", "state", "mode", "bands", "strips", "psf_px", "prior", "nsr", "weight", "seconds"),
    *("verdict", "reasons", "error"),
)

HELP = f"""Deblur many photos: those of a manifest, of a logger's folder, or several PHOTOs.

A photo that fails does not stop the others.

MANIFEST is a CSV file with a line for each photo. Its first line names the columns: photo, and if needed
{", ".join(name for name in COLUMNS if name != "photo")}. They mean what the options of `deblur` mean; empty cells take
the options given here. FOLDER is a session of MARS logger or OpenCamera Sensors that contains photos or frames. PHOTOs
share the log and the camera; their exposures come from EXIF, with --start exif, or from --capture, by the timestamps or
frame numbers in their names.

A second run skips the photos that are done, which batch.json lists. The command writes batch.csv and batch.json beside
the photos. Exit code 3: some photos failed.
"""
EXAMPLES = """\b
Examples:
  rsdeblur batch manifest.csv -o sharp
  rsdeblur batch manifest.csv --gyro gyro.csv --camera phone.toml --capture frames.csv --jobs 4 -o sharp
  rsdeblur batch mars_session/ --camera phone.toml -o sharp --dry-run
  rsdeblur batch a.jpg b.jpg --gyro Gyroscope.csv --camera phone.toml --start exif -o sharp
  rsdeblur batch manifest.csv -o sharp --scheduler tcp://cluster:8786
"""


@click.command("batch", cls=Command, help=HELP, epilog=EXAMPLES)
@click.argument("sources", type=PATH, metavar="MANIFEST|FOLDER|PHOTO...", nargs=-1, required=True)
@_options.recording_options(*SERIES, required=())
@_options.solve_options(*(name for name in _options.SOLVE if name != "refine"))
@_options.refine_option
@_options.jobs_option("processes", "half the number of cores")
@option(
    "--scheduler",
    section=COMPUTING,
    metavar="ADDRESS",
    help="Dask scheduler whose workers do the work; they need the same files.",
)
@_options.target_options(
    "DIR",
    "Folder to write to.  [default: MANIFEST-sharp or FOLDER-sharp beside it; of photos, that of their first folder]",
    default=lambda sources, **_: _options.beside(sources[0] if len(sources) == 1 else sources[0].parent, SHARP),
    dry_run=True,
    report=True,
)
def command(
    sources: tuple[Path, ...],
    recording: Recording,
    options: Options,
    refine: bool | None,
    jobs: int | None,
    scheduler: str | None,
    target: Target,
) -> None:
    """Deblur many photos."""
    run(sources, recording, options, refine, target, jobs=jobs, scheduler=scheduler)


def run(
    sources: tuple[Path, ...],
    recording: Recording,
    options: Options,
    refine: bool | None,
    target: Target,
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Deblur the photos of a manifest or of a folder, or several, and write and print their table."""
    options = _options.with_refinement(options, refine)
    items = read_items(sources, recording, target.output)
    if not items:
        raise InputError(f"{sources[0]}: there is nothing to do, because no photo is listed")
    jobs, threads = shared_threads(jobs, options.threads, alone=scheduler is None)
    earlier = _earlier(target.output / BATCH)
    prepare_folder(target.output, [TABLE, BATCH], force=target.force or bool(earlier), dry_run=target.dry_run)
    batch = _Batch(target, items, earlier)
    begin = time.perf_counter()
    batch.run(replace(options, threads=threads), bool(refine), jobs, scheduler)
    summary = batch.summary() | {"seconds": time.perf_counter() - begin}
    if target.report is not None and not target.dry_run:
        rs.write_batch_page(
            target.report, batch.entries, title=sources[0].name if len(sources) == 1 else f"{len(sources)} photos"
        )
    if target.as_json:
        print_json(summary)
    else:
        _print(summary, target)
    for entry in batch.entries:
        if "error" in entry:
            say_aside(f"error: {entry['error']}")
    if any("error" in entry for entry in batch.entries):
        click.get_current_context().exit(SOME_FAILED)


def _earlier(path: Path) -> dict[str, Any]:
    """Return what an earlier run wrote to ``batch.json``; empty if there is none, or it is another program's."""
    try:
        found: dict[str, Any] = json.loads(read_file(path, "list of results"))
        return found if found.pop("digest") == _digest(found) else {}
    except (ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return {}


class _Batch:
    """A batch in progress: `entries` are what is known about each item; those that are finished have a state."""

    def __init__(self, target: Target, items: list[Item], earlier: dict[str, Any]) -> None:
        self._target, self._items = target, items
        # Recipe of the result that each name has or gets, and the earlier entries of results.
        self._recipes: dict[str, str] = dict(earlier.get("recipes", {}))
        self._earlier: list[Any] = earlier.get("items", [])
        self.entries: list[dict[str, Any]] = [{"photo": str(item.photo)} for item in items]

    def run(self, options: Options, refine_anyway: bool, jobs: int, scheduler: str | None) -> None:
        """Deblur the photos that are not done yet."""
        tasks = dict(self._tasks(options, refine_anyway))
        # Folders that do not exist before their items start.
        folders = {folder for job in tasks.values() for folder in job.output.parents if not folder.exists()}
        if tasks:
            # From now on a result with this name is of this recipe: it is written as a whole, or not at all.
            self._write({"items": self._earlier})
        here = tasks if scheduler is None else {i: _absolute(job) for i, job in tasks.items()}
        answers = rs.run(work, here.items(), jobs=jobs, scheduler=scheduler, lost=_tidy)
        try:
            with progress("batch") as move, closing(answers) as done:
                for (i, _), answer in done:
                    with _as_row(self.entries[i]):
                        if isinstance(answer, rs.Failure):
                            raise InputError(answer.message)
                        self._finish(tasks[i], self._items[i], self.entries[i], answer)
                    if move is not None:
                        finished = sum("state" in entry for entry in self.entries)
                        move(f"{finished} of {len(self.entries)}", finished / len(self.entries))
        finally:
            # A worker cannot remove folders of items that failed, as another may be about to write there.
            for folder in sorted(folders, reverse=True):
                with suppress(OSError):
                    folder.rmdir()
            if self._earlier and all(entry.get("state") == "failed" for entry in self.entries):
                say_aside(f"{TABLE} and {BATCH}: left as they are, because earlier results stand and none is new")
            else:
                self._write(self.summary())

    def summary(self) -> dict[str, Any]:
        """Return the finished entries, and how many there are of each state and verdict."""
        finished = [entry for entry in self.entries if "state" in entry]
        verdicts = Counter(entry["check"]["verdict"] for entry in finished if entry.get("check"))
        return {"items": finished, "counts": Counter(entry["state"] for entry in finished), "verdicts": verdicts}

    def _write(self, summary: dict[str, Any]) -> None:
        if self._target.dry_run:
            return
        content = summary | {"recipes": self._recipes}
        write_json(self._target.output / BATCH, content | {"digest": _digest(content)})
        write_table(self._target.output / TABLE, COLUMNS_OF_TABLE, map(_row, summary["items"]))

    def _tasks(self, options: Options, refine_anyway: bool) -> Iterator[tuple[int, PhotoJob]]:
        """Yield the jobs to do by the items' numbers; the other items get their states."""
        known = {entry["recipe"]: entry for entry in self._earlier if "check" in entry}
        force, dry_run = self._target.force, self._target.dry_run
        for i, (item, entry) in enumerate(zip(self._items, self.entries, strict=True)):
            with _as_row(entry):
                if item.recording is None or item.error is not None:
                    raise InputError(item.error or "no recording")
                job = PhotoJob(
                    photo=item.photo,
                    recording=item.recording,
                    output=self._target.output / item.output,
                    force=force,
                    dry_run=dry_run,
                    make_folder=True,
                    options=options,
                    refine_anyway=refine_anyway,
                )
                name, exists = str(item.output), job.output.exists()
                recipe, recorded = _recipe(job, name), self._recipes.get(name)
                if exists and not force and recorded == recipe:
                    entry |= known.get(recipe, {}) | entry | {"state": "skipped", "output": str(job.output)}
                    continue
                if exists and not force and recorded:
                    raise OutputError(
                        f"{job.output}: the file exists; use force (--force) to replace it, or another folder: it was "
                        "made with other options or from other files, or these have another date"
                    )
                if not exists:
                    self._recipes[name] = recipe
                elif force:
                    # Until it is replaced, the file is of another recipe.
                    self._recipes.pop(name, None)
                entry |= {"output": str(job.output), "recipe": recipe}
                yield i, job

    def _finish(self, job: PhotoJob, item: Item, entry: dict[str, Any], facts: dict[str, Any]) -> None:
        for message in facts.pop("warnings"):
            warn(message if str(job.photo) in message else f"{job.photo}: {message}")
        entry |= facts | {"state": "checked" if job.dry_run else "done", "output": str(job.output)}
        self._recipes[str(item.output)] = entry["recipe"]


@contextmanager
def _as_row(entry: dict[str, Any]) -> Iterator[None]:
    """Turn an error into the state of its row: whatever fails, the other photos are deblurred."""
    try:
        yield
    except (RsdeblurError, OSError, ValueError) as error:
        entry |= {"state": "failed", "error": reason(error, entry["photo"])}


def work(task: tuple[int, PhotoJob]) -> dict[str, Any]:
    """Deblur one photo, in a worker."""
    with capture_warnings(show=False) as messages, usage_as_input_error():
        facts = deblur_photo(task[1])
    return facts | {"warnings": messages}


def _absolute(job: PhotoJob) -> PhotoJob:
    """Return the job with absolute paths, for workers that run in another folder."""
    files = {name: path.absolute() for name in FILES if (path := getattr(job.recording, name)) is not None}
    recording = replace(job.recording, **files)
    return replace(job, photo=job.photo.absolute(), output=job.output.absolute(), recording=recording)


def _tidy(task: tuple[int, PhotoJob]) -> None:
    """Remove what a worker that was killed has left."""
    # Its row has the error of an output that no file can be.
    with suppress(OSError):
        remove_unfinished(task[1].output)


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _recipe(job: PhotoJob, name: str) -> str:
    """Return a text that changes with all that the result depends on: its settings and its files.

    Files are compared by name, size and date, so that a folder may be moved.
    """
    # Any number of threads gives the same bits.
    settings = [name, replace(job.options, threads=None), job.refine_anyway]
    settings += [value for key, value in asdict(job.recording).items() if key not in FILES]
    files = [job.photo, *(getattr(job.recording, key) for key in FILES)]
    return _digest(repr((settings, [path and (path.name, *(file_state(path) or ())[2:]) for path in files])))


def _row(entry: dict[str, Any]) -> dict[str, Any]:
    """Return what the table has of an entry."""
    size = {"psf_px": "{}x{}".format(*entry["psf_px"])} if "psf_px" in entry else {}
    check = entry.get("check")
    verdict = {} if check is None else {"verdict": check["verdict"], "reasons": " ".join(check["reasons"])}
    return entry | size | verdict


def _print(summary: dict[str, Any], target: Target) -> None:
    rows = []
    for row in map(_row, summary["items"]):
        tiles = f"{row['bands']} x {row['strips']}" if "bands" in row else ""
        seconds = f"{row['seconds']:.2f}" if "seconds" in row else ""
        rows.append([row["photo"], row["state"], tiles, row.get("psf_px", ""), seconds, row.get("verdict", "")])
    print_table(["photo", "state", "bands x strips", "PSF px", "time s", "check"], rows)
    counts = ", ".join(f"{count} {state}" for state, count in summary["counts"].items())
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(summary["verdicts"].items()))
    place = "" if target.dry_run else f"; see {target.output}"
    say(f"{counts}{f' ({verdicts})' if verdicts else ''}; {summary['seconds']:.1f} s{place}")
