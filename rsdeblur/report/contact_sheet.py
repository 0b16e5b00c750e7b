"""Grid of many results of one picture, each with its kernel, for choosing by eye."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rsdeblur.errors import InputError
from rsdeblur.report._draw import GROUND, MARKS, caption, display, rgb8
from rsdeblur.types import FloatImage

CELL = 480  # px, width of a cell
KERNEL = 96  # px, longer side of the largest kernel; all kernels have one scale
GUTTER = 8  # px between cells
TITLE = 28  # px above each cell

Cell = tuple[str, NDArray[np.floating], NDArray[np.floating]]


def contact_sheet(cells: Sequence[Cell], *, marked: int | None = None) -> FloatImage:
    """Lay results out in a grid that is as square as possible.

    Parameters
    ----------
    cells : sequence of (label, picture, kernel)
        Display values in [0, 1], all pictures of one size. The kernel is drawn into the upper right corner, brightened
        to its peak.
    marked : int, optional
        Index of a cell to frame.

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        Display values in [0, 1].

    Raises
    ------
    InputError
        If there is no cell, or the shapes of the pictures differ.
    """
    if not cells:
        raise InputError("cells must contain at least one result")
    if len({picture.shape for _, picture, _ in cells}) > 1:
        raise InputError("all pictures of a contact sheet must have one shape")
    tall, wide = cells[0][1].shape[:2]
    height = max(round(CELL * tall / wide), KERNEL)
    columns = max(1, min(len(cells), round(math.sqrt(len(cells) * (height + TITLE) / CELL))))
    rows = -(-len(cells) // columns)
    pitch = CELL + GUTTER, height + TITLE + GUTTER
    sheet = Image.new("RGB", (columns * pitch[0] + GUTTER, rows * pitch[1] + GUTTER), GROUND)
    zoom = KERNEL / max(max(kernel.shape) for _, _, kernel in cells)
    for i, (label, picture, kernel) in enumerate(cells):
        x, y = GUTTER + (i % columns) * pitch[0], GUTTER + (i // columns) * pitch[1]
        caption(sheet, (x + 2, y + 3), label, size=18)
        sheet.paste(rgb8(label, picture).resize((CELL, height), Image.Resampling.LANCZOS), (x, y + TITLE))
        _paste(sheet, kernel, zoom, (x + CELL, y + TITLE))
        if i == marked:
            box = (x - 3, y + TITLE - 3, x + CELL + 2, y + TITLE + height + 2)
            ImageDraw.Draw(sheet).rectangle(box, outline=MARKS[0], width=3)
    return display(sheet)


def _paste(sheet: Image.Image, kernel: NDArray[np.floating], zoom: float, corner: tuple[int, int]) -> None:
    """Draw a kernel, white on black, with its upper right corner at `corner`."""
    values = np.asarray(kernel, dtype=np.float64)
    size = max(round(values.shape[1] * zoom), 8), max(round(values.shape[0] * zoom), 8)
    drawn = rgb8("kernel", np.sqrt(values / max(values.max(), 1e-30))).resize(size, Image.Resampling.BICUBIC)
    sheet.paste(drawn, (corner[0] - size[0], corner[1]))
