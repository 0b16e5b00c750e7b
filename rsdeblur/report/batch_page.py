"""The page of a batch: a thumbnail of every photo beside its result, the most doubtful first."""

from __future__ import annotations

import base64
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from PIL import Image, ImageOps

from rsdeblur._util.atomic import atomic_write
from rsdeblur.choices import VERDICTS
from rsdeblur.report.page import VERDICT_LEVELS, allowed_hash

# px of a thumbnail's longer side, and its JPEG quality: 200 photos take about 6 MB.
SIDE, QUALITY = 280, 80
# Verdicts on items, the worst first.
ORDER = ("failed", *reversed(VERDICTS), "not checked")


def write_batch_page(
    path: str | os.PathLike[str], entries: Sequence[Mapping[str, Any]], *, title: str = "Batch"
) -> None:
    """Write the thumbnails and the verdicts of a batch as one file of HTML.

    Parameters
    ----------
    path : path-like
        The file. An existing one is replaced.
    entries : sequence of mapping
        The items as `rsdeblur batch` reports them in ``batch.json``.
    title : str, default "Batch"
        Heading of the page.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    page = Path(path)
    template, style = (
        files("rsdeblur.report").joinpath(name).read_text("utf-8") for name in ("batch.html", "page.css")
    )
    counts = Counter(verdict_of(entry) for entry in entries)
    text = Template(template).substitute(
        title=escape(title),
        policy=f"default-src 'none'; img-src data:; style-src {allowed_hash(style)}",
        style=style,
        summary=", ".join(f"{counts[verdict]} {verdict}" for verdict in ORDER if counts[verdict]),
        items="\n".join(_item(entry, page.parent) for entry in sorted(entries, key=_rank)),
    )
    with atomic_write(page) as file:
        file.write(text.encode("utf-8", "replace"))


def verdict_of(entry: Mapping[str, Any]) -> str:
    """Return the verdict on an item: that of the check, "failed" or "not checked"."""
    if "error" in entry:
        return "failed"
    return str((entry.get("check") or {}).get("verdict", "not checked"))


def _rank(entry: Mapping[str, Any]) -> int:
    return ORDER.index(verdict_of(entry))


def _item(entry: Mapping[str, Any], folder: Path) -> str:
    verdict = verdict_of(entry)
    level = "note" if verdict == "not checked" else VERDICT_LEVELS.get(verdict, "warning")
    reasons = entry.get("error") or " ".join((entry.get("check") or {}).get("reasons", ()))
    name = escape(Path(entry["photo"]).name)
    images = _image(Path(entry["photo"]), f"{name}, the photo")
    if "error" not in entry and "output" in entry:
        link = escape(quote(os.path.relpath(entry["output"], folder)))
        images += f'<a href="{link}">{_image(Path(entry["output"]), f"{name}, the result")}</a>'
    badge = f'<span class="verdict {level}">{verdict}</span>'
    return f"<figure>{images}<figcaption>{badge} {name}<br>{escape(str(reasons))}</figcaption></figure>"


def _image(path: Path, label: str) -> str:
    """Return a thumbnail, or the label alone if the file is no picture that Pillow reads."""
    try:
        with Image.open(path) as picture:
            picture.draft("RGB", (SIDE, SIDE))
            small = ImageOps.exif_transpose(picture).convert("RGB")
            small.thumbnail((SIDE, SIDE))
    except (OSError, ValueError, Image.DecompressionBombError):
        return f"<span>{label}</span>"
    data = BytesIO()
    small.save(data, "JPEG", quality=QUALITY)
    return f'<img src="data:image/jpeg;base64,{base64.b64encode(data.getvalue()).decode()}" alt="{label}">'
