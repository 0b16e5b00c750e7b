"""A figure of the evaluation: text, table and drawing, and how they are written."""

from __future__ import annotations

import csv
import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Cell = str | float
Draw = Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure or table, measured.

    Parameters
    ----------
    name : str
        File name without extension.
    title : str
    about : str
        Description of the measurement.
    finding : str
        One sentence: whether the paper's finding holds here.
    columns : sequence of str
    rows : sequence of sequences
        Text or numbers, as many as columns.
    draw : callable
        Draws onto a `matplotlib.figure.Figure`.
    """

    name: str
    title: str
    about: str
    finding: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    draw: Draw

    def write(self, folder: Path, **facts: Cell) -> None:
        """Write CSV, JSON and SVG; the JSON also contains `facts` about the run."""
        import matplotlib as mpl
        from matplotlib.figure import Figure as Canvas

        with (folder / f"{self.name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([self.columns, *self.rows])
        record = {key: getattr(self, key) for key in ("name", "title", "about", "finding", "columns", "rows")}
        (folder / f"{self.name}.json").write_text(json.dumps(facts | record, indent=1) + "\n")
        # Text stays text and there is no date, so the file changes only when the drawing does.
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "rsdeblur"}):
            canvas = Canvas(figsize=(9, 3.6), layout="constrained")
            self.draw(canvas)
            canvas.savefig(folder / f"{self.name}.svg", metadata={"Date": None}, dpi=110)


def section(record: Mapping[str, Any]) -> str:
    """Return the section of a figure, from its JSON; the table is in its CSV."""
    name = record["name"]
    parts = (
        f"## {record['title']}",
        _wrapped(f"**{record['finding']}**"),
        _wrapped(f"{record['about']} [Numbers](paper/{name}.csv)"),
        f"![{record['title']}](paper/{name}.svg)",
    )
    return "\n\n".join(parts)


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 120, break_long_words=False, break_on_hyphens=False)


def lines(
    x: Sequence[float],
    curves: Mapping[str, Sequence[float]],
    xlabel: str,
    ylabel: str,
    **settings: Any,
) -> Draw:
    """Return a function that draws curves over common positions."""

    def draw(canvas: Any) -> None:
        axes = canvas.subplots()
        for label, y in curves.items():
            axes.plot(x, y, "o-", markersize=3, label=label)
        axes.set(xlabel=xlabel, ylabel=ylabel, **settings)
        axes.grid(alpha=0.3)
        axes.legend()

    return draw


def pictures(panels: Mapping[str, Any], columns: int = 4) -> Draw:
    """Return a function that draws grey pictures, values in [0, 1], in a grid."""

    def draw(canvas: Any) -> None:
        rows = -(-len(panels) // columns)
        canvas.set_size_inches(9, 2.3 * rows)
        places = canvas.subplots(rows, columns, squeeze=False).ravel()
        for axes in places:
            axes.axis("off")
        for axes, (label, picture) in zip(places, panels.items(), strict=False):
            axes.imshow(picture, cmap="gray", vmin=0, vmax=1, interpolation="none")
            axes.set_title(label, fontsize=7)

    return draw
