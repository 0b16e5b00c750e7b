"""`rsdeblur batch`: deblur many photos in worker processes."""

from __future__ import annotations

import csv
import io
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.choices import RECORDS, SHARP
from rsdeblur.cli import _options, _refinement
from rsdeblur.cli._command import Command
from rsdeblur.cli._items import COLUMNS, FILES, Item, numbered_from_option, read_items
from rsdeblur.cli._jobs import Workers, shared_threads, workers_options
from rsdeblur.cli._options import Defaults, Target
from rsdeblur.cli._output import (
    SOME_FAILED,
    check_page,
    level,
    plain_cell,
    prepare_folder,
    print_json,
    print_table,
    progress,
    say,
    say_aside,
    write_json,
)
from rsdeblur.cli._photo import PhotoJob, deblur_photo
from rsdeblur.cli._types import PATH
from rsdeblur.errors import InputError, OutputError, RsdeblurError, RsdeblurWarning

if TYPE_CHECKING:
    from rsdeblur._util.records import Records
    from rsdeblur._util.workers import Limits
    from rsdeblur.pipeline.options import Options

TABLE, REPORT = "batch.csv", "batch.json"
# Rows of a table that fits a screen.
MOST_ROWS = 40

HELP = f"""Deblur all photos of a manifest or of a logger's folder.

A photo that fails does not stop the others.

MANIFEST is a CSV file with a line for each photo. Its first line names the columns: photo, and if needed
{", ".join(name for name in COLUMNS if name != "photo")}. They mean what the options of `deblur` mean; empty cells take
the options given here. FOLDER is a session of MARS logger or OpenCamera Sensors that contains photos or frames.

A second run skips the photos that are done. The command writes batch.csv and batch.json beside the photos. Exit code
3: some photos failed.
"""
EXAMPLES = """\b
Examples:
  rsdeblur batch manifest.csv -o sharp
  rsdeblur batch manifest.csv --gyro gyro.csv --camera phone.toml --capture frames.csv --jobs 4 -o sharp
  rsdeblur batch mars_session/ --camera phone.toml -o sharp --dry-run
  rsdeblur batch manifest.csv -o sharp --scheduler tcp://cluster:8786
"""


def _only(ctx: click.Context, param: click.Parameter, value: tuple[Path, ...]) -> Path:
    """Return the only file or folder; several are probably photos that a shell listed."""
    if len(value) > 1:
        raise click.UsageError(
            f"{len(value)} files, but batch takes one manifest or folder; for photos by name: rsdeblur deblur PHOTO...",
            ctx,
        )
    return value[0]


@click.command("batch", cls=Command, help=HELP, epilog=EXAMPLES)
@click.argument("source", type=PATH, metavar="MANIFEST|FOLDER", nargs=-1, required=True, callback=_only)
@_options.defaults_options
@numbered_from_option
@_options.solve_options(*_options.ONE_PHOTO, *_options.ONE_RESULT)
@_refinement.option
@workers_options
@_options.target_options(
    "DIR",
    "Folder to write to.  [default: MANIFEST-sharp or FOLDER-sharp beside it]",
    default=lambda source, **_: _options.beside(source, SHARP),
    force=click.option("--force", is_flag=True, help="Deblur finished photos again, and replace files that exist."),
    dry_run=True,
)
@click.option("--report", type=PATH, metavar="HTML", help="Also write a page of thumbnails with the verdicts.")
def command(
    source: Path,
    defaults: Defaults,
    numbered_from: int | None,
    options: Options,
    refine: bool | None,
    workers: Workers,
    target: Target,
    report: Path | None,
) -> None:
    """Deblur the photos of a manifest or of a session folder."""
    from rsdeblur._util.records import Records

    begin = time.perf_counter()
    options = _refinement.with_refinement(options, refine)
    items = read_items(source, defaults, target.output, numbered_from=numbered_from)
    if not items:
        raise InputError(f"{source}: there is nothing to do, because no photo is listed")
    if report is not None:
        check_page(report, force=target.force)
    jobs, threads = shared_threads(workers.jobs, options.threads, alone=workers.scheduler is None)
    limits = workers.limits(jobs)
    records = Records(target.output / RECORDS)
    is_own = target.force or records.folder.is_dir()
    prepare_folder(target.output, [TABLE, REPORT], force=is_own, dry_run=target.dry_run)
    with nullcontext() if target.dry_run else records.held():
        batch = _Batch(target, replace(options, threads=threads), records, refine_anyway=bool(refine))
        entries = batch.run(items, jobs, workers.scheduler, limits)
        counts = Counter(entry["state"] for entry in entries)
        verdicts = Counter(entry["check"]["verdict"] for entry in entries if entry.get("check"))
        summary: dict[str, Any] = {"items": entries, "counts": dict(counts), "verdicts": dict(verdicts)}
        summary["seconds"] = time.perf_counter() - begin
        if not target.dry_run:
            if counts["failed"] == len(entries) and any(Path(entry.get("output", "")).is_file() for entry in entries):
                say_aside(f"{TABLE} and {REPORT}: left as they are, because earlier results stand and none is new")
            else:
                _write_table(target.output / TABLE, entries)
                write_json(target.output / REPORT, summary)
            if report is not None:
                from rsdeblur.report import write_batch_page

                write_batch_page(report, entries, title=source.name)
    if target.as_json:
        print_json(summary)
    else:
        _print(summary, target)
    for entry in entries:
        if "error" in entry:
            say_aside(f"error: {entry['error']}")
    if counts["failed"]:
        click.get_current_context().exit(SOME_FAILED)


class _Batch:
    """A batch in progress."""

    def __init__(
        self,
        target: Target,
        options: Options,
        records: Records,
        *,
        refine_anyway: bool,
    ) -> None:
        self._target, self._options, self._records = target, options, records
        self._refine_anyway = refine_anyway
        self._under_way: dict[int, PhotoJob] = {}
        self._is_remote = False
        # Folders that do not exist before their items start.
        self._new_folders: set[Path] = set()

    def run(self, items: list[Item], jobs: int, scheduler: str | None, limits: Limits | None) -> list[dict[str, Any]]:
        """Deblur the photos that are not done yet, and return an entry for each item."""
        from rsdeblur._util.workers import Failure, run

        self._is_remote = scheduler is not None
        entries: list[dict[str, Any]] = [self._entry(item) for item in items]
        tasks = self._tasks(items, entries)
        answers = run(work, tasks, jobs=jobs, scheduler=scheduler, lost=_tidy, announce=say_aside, limits=limits)
        with progress("batch") as move, closing(answers) as done:
            try:
                for (i, job), answer in done:
                    del self._under_way[i]
                    with _as_row(entries[i]):
                        if isinstance(answer, Failure):
                            raise InputError(answer.message)
                        self._finish(items[i], job, entries[i], answer)
                    if move is not None:
                        finished, failed = (sum(key in entry for entry in entries) for key in ("state", "error"))
                        move(f"{finished} of {len(items)}, {failed} failed", finished / len(items))
            finally:
                # The workers end first, because those that are killed leave unfinished files.
                done.close()
                for i, job in self._under_way.items():
                    _tidy((i, job))
                self._remove_empty_folders()
        return entries

    def _entry(self, item: Item) -> dict[str, Any]:
        """Return the entry of an item before the work; it has a state if the item needs no work."""
        entry: dict[str, Any] = {"photo": str(item.photo)}
        with _as_row(entry):
            if item.error is not None:
                raise InputError(item.error)
            job = self._job(item)
            entry["output"] = str(job.output)
            record = None if self._target.force else self._records.facts(str(item.output), _fingerprint(job))
            size = job.output.stat().st_size if record is not None and job.output.is_file() else 0
            # Nothing of value is in an empty file; another size may be the user's work.
            if record is not None and size:
                entry |= {"state": "skipped"} | record["entry"]
                if size != record["bytes"]:
                    message = f"{job.output}: the file has changed since it was written; it is left as it is"
                    warnings.warn(message, RsdeblurWarning, stacklevel=2)
        return entry

    def _job(self, item: Item) -> PhotoJob:
        assert item.recording is not None
        return PhotoJob(
            photo=item.photo,
            recording=item.recording,
            output=self._target.output / item.output,
            force=self._target.force,
            dry_run=self._target.dry_run,
            make_folder=True,
            options=self._options,
            refine_anyway=self._refine_anyway,
        )

    def _tasks(self, items: list[Item], entries: list[dict[str, Any]]) -> Iterator[tuple[int, PhotoJob]]:
        """Yield the jobs to do, and record that this batch writes their outputs."""
        for i, item in enumerate(items):
            if "state" in entries[i]:
                continue
            with _as_row(entries[i]):
                job = self._claimed(item)
                self._under_way[i] = job
                self._new_folders.update(folder for folder in job.output.parents if not folder.exists())
            if i in self._under_way:
                yield i, _absolute(job) if self._is_remote else job

    def _claimed(self, item: Item) -> PhotoJob:
        """Return the job of an item, and record that this batch writes its output."""
        job, name = self._job(item), str(item.output)
        fingerprint = _fingerprint(job)
        # A file that an interrupted run of this batch left under this name may be replaced.
        job = replace(job, force=self._target.force or self._records.claimed(name, fingerprint))
        if job.output.exists() and not job.force and self._records.known(name):
            raise OutputError(
                f"{job.output}: the file exists; use force (--force) to replace it, or another folder: it was made "
                "with other options or from other files, or these have another date"
            )
        if not self._target.dry_run and (job.force or not job.output.exists()):
            self._records.claim(name, fingerprint)
        return job

    def _remove_empty_folders(self) -> None:
        """Remove the folders of items that all failed; a worker cannot, as another may be about to write there."""
        for folder in sorted(self._new_folders, reverse=True):
            with suppress(OSError):
                folder.rmdir()

    def _finish(self, item: Item, job: PhotoJob, entry: dict[str, Any], facts: dict[str, Any]) -> None:
        facts["output"] = str(job.output)
        for message in facts.pop("warnings"):
            named = message if str(job.photo) in message else f"{job.photo}: {message}"
            warnings.warn(named, RsdeblurWarning, stacklevel=2)
        entry |= {"state": "checked" if self._target.dry_run else "done"} | facts
        if not self._target.dry_run:
            record = {"entry": facts, "bytes": job.output.stat().st_size}
            self._records.finish(str(item.output), _fingerprint(job), record)


@contextmanager
def _as_row(entry: dict[str, Any]) -> Iterator[None]:
    """Turn an error into the state of its row: whatever fails, the other photos are deblurred."""
    try:
        yield
    except (RsdeblurError, OSError, ValueError) as error:
        reason = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            reason = f"{error.filename}: {error.strerror}"
        message = reason if entry["photo"] in reason else f"{entry['photo']}: {reason}"
        entry |= {"state": "failed", "error": message}


def work(task: tuple[int, PhotoJob]) -> dict[str, Any]:
    """Deblur one photo, in a worker."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        try:
            facts = deblur_photo(task[1])
        except click.ClickException as error:
            raise InputError(error.format_message()) from error
    messages = [str(warning.message) for warning in caught if issubclass(warning.category, RsdeblurWarning)]
    return facts | {"warnings": messages}


def _absolute(job: PhotoJob) -> PhotoJob:
    """Return the job with absolute paths, for workers that run in another folder."""
    files = {name: path.absolute() for name in FILES if (path := getattr(job.recording, name)) is not None}
    recording = replace(job.recording, **files)
    return replace(job, photo=job.photo.absolute(), output=job.output.absolute(), recording=recording)


def _tidy(task: tuple[int, PhotoJob]) -> None:
    from rsdeblur._util.atomic import remove_unfinished

    # Its row has the error of an output that no file can be.
    with suppress(OSError):
        remove_unfinished(task[1].output)


def _fingerprint(job: PhotoJob) -> str:
    from rsdeblur._util.records import fingerprint

    # Any number of threads gives the same bits.
    settings = [replace(job.options, threads=None), job.refine_anyway]
    recording = {name: value for name, value in asdict(job.recording).items() if name not in FILES}
    files = [job.photo, *(getattr(job.recording, name) for name in FILES)]
    return fingerprint([*settings, recording], files)


def _write_table(path: Path, entries: list[dict[str, Any]]) -> None:
    from rsdeblur._util.atomic import atomic_write

    columns = ("photo", "output", "state", "mode", "bands", "strips", "psf_px", "prior", "nsr", "weight", "seconds")
    text = io.StringIO()
    table = csv.DictWriter(text, (*columns, "verdict", "reasons", "error"), extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for entry in entries:
        size = {"psf_px": "{}x{}".format(*entry["psf_px"])} if "psf_px" in entry else {}
        check = entry.get("check")
        verdict = {} if check is None else {"verdict": check["verdict"], "reasons": " ".join(check["reasons"])}
        table.writerow({name: plain_cell(value) for name, value in (entry | size | verdict).items()})
    with atomic_write(path) as file:
        file.write(text.getvalue().encode())


def _print(summary: dict[str, Any], target: Target) -> None:
    entries = summary["items"]
    # Of a long list, the table has only what needs a look.
    shown = entries if len(entries) <= MOST_ROWS or level() > 0 else [entry for entry in entries if not _is_good(entry)]
    rows = []
    for entry in shown:
        tiles = f"{entry['bands']} x {entry['strips']}" if "bands" in entry else ""
        size = "{} x {}".format(*entry["psf_px"]) if "psf_px" in entry else ""
        seconds = f"{entry['seconds']:.2f}" if "seconds" in entry else ""
        check = entry.get("check")
        verdict = "" if check is None else check["verdict"]
        rows.append([entry["photo"], entry["state"], tiles, size, seconds, verdict])
    print_table(["photo", "state", "bands x strips", "PSF px", "time s", "check"], rows)
    if len(shown) < len(entries):
        say(f"({len(entries) - len(shown)} good results are not listed; {TABLE} has all)")
    counts = ", ".join(f"{count} {state}" for state, count in summary["counts"].items())
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(summary["verdicts"].items()))
    place = "" if target.dry_run else f"; see {target.output}"
    say(f"{counts}{f' ({verdicts})' if verdicts else ''}; {summary['seconds']:.1f} s{place}")


def _is_good(entry: dict[str, Any]) -> bool:
    return "error" not in entry and (entry.get("check") or {}).get("verdict", "good") == "good"
