"""What every figure of the evaluation consists of, and how it is written."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.tables import markdown

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
        What was done.
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

    def write(self, folder: Path) -> None:
        """Write CSV, JSON and SVG."""
        import matplotlib as mpl
        from matplotlib.figure import Figure as Canvas

        with (folder / f"{self.name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([self.columns, *self.rows])
        record = {"title": self.title, "finding": self.finding, "columns": self.columns, "rows": self.rows}
        (folder / f"{self.name}.json").write_text(json.dumps(record, indent=1) + "\n")
        # Text as text, and no date: the file changes only when the picture does.
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "rsdeblur"}):
            canvas = Canvas(figsize=(9, 3.6), layout="constrained")
            self.draw(canvas)
            canvas.savefig(folder / f"{self.name}.svg", metadata={"Date": None}, dpi=110)

    def section(self) -> str:
        """Return the figure's part of the page."""
        table = markdown(self.columns, [[_text(cell) for cell in row] for row in self.rows])
        parts = (
            f"## {self.title}",
            self.about,
            f"**{self.finding}**",
            f"![{self.title}](paper/{self.name}.svg)",
            table,
        )
        return "\n\n".join(parts)


def _text(cell: Cell) -> str:
    return cell if isinstance(cell, str) else f"{cell:.4g}"


def lines(
    x: Sequence[float],
    curves: Mapping[str, Sequence[float]],
    xlabel: str,
    ylabel: str,
    **settings: Any,
) -> Draw:
    """Return what draws curves over common positions."""

    def draw(canvas: Any) -> None:
        axes = canvas.subplots()
        for label, y in curves.items():
            axes.plot(x, y, "o-", markersize=3, label=label)
        axes.set(xlabel=xlabel, ylabel=ylabel, **settings)
        axes.grid(alpha=0.3)
        axes.legend()

    return draw


def pictures(panels: Mapping[str, Any]) -> Draw:
    """Return what draws grey pictures, values in [0, 1], beside each other."""

    def draw(canvas: Any) -> None:
        for axes, (label, picture) in zip(
            canvas.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
        ):
            axes.imshow(picture, cmap="gray", vmin=0, vmax=1, interpolation="none")
            axes.set_title(label, fontsize=7)
            axes.axis("off")

    return draw
