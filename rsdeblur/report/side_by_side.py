"""Pictures side by side, with the same details enlarged below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rsdeblur.errors import InputError
from rsdeblur.report._draw import GROUND, MARKS, caption, display, rgb8
from rsdeblur.types import FloatArray, FloatImage

Box = tuple[int, int, int, int]

PANEL = 560  # px, width of a panel
GUTTER = 10  # px between panels
TITLE = 34  # px above each panel
BORDER = 24  # px along the picture's edge that are not searched for details: deblurring is worst there


def side_by_side(images: Mapping[str, NDArray[np.floating]], *, crops: int | Sequence[Box] = 3) -> FloatImage:
    """Lay labelled pictures side by side, and below each the same details enlarged.

    Parameters
    ----------
    images : mapping of str to ndarray
        Display values in [0, 1], grey or RGB, all of one height and width; the keys are the labels.
    crops : int or sequence of (top, left, height, width), default 3
        The details in px, or their number. By number, the picture is divided into that many horizontal parts, and the
        box with most detail is chosen in each.

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        Display values in [0, 1].

    Raises
    ------
    InputError
        If there is no picture, the sizes differ, or a crop does not lie within the picture.
    """
    if not images:
        raise InputError("images must contain at least one picture")
    panels = {label: rgb8(f"picture {label!r}", image) for label, image in images.items()}
    width, height = next(iter(panels.values())).size
    for label, panel in panels.items():
        if panel.size != (width, height):
            raise InputError(
                f"picture {label!r} has {panel.width}x{panel.height} px, the first has {width}x{height}; "
                "pictures side by side need one size"
            )
    boxes = _detailed(panels, crops) if isinstance(crops, int) else list(crops)
    for top, left, tall, wide in boxes:
        if min(top, left) < 0 or min(tall, wide) < 1 or top + tall > height or left + wide > width:
            raise InputError(f"the crop {(top, left, tall, wide)} does not lie within the picture of {width}x{height}")
    columns = [_column(label, panel, boxes) for label, panel in panels.items()]
    sheet = Image.new("RGB", (len(columns) * (PANEL + GUTTER) + GUTTER, columns[0].height + GUTTER), GROUND)
    for i, column in enumerate(columns):
        sheet.paste(column, (GUTTER + i * (PANEL + GUTTER), 0))
    return display(sheet)


def _column(label: str, panel: Image.Image, boxes: Sequence[Box]) -> Image.Image:
    """Return one panel with its title above and its details below."""
    overview = _to_width(panel, PANEL)
    scale = PANEL / panel.width
    details = [_to_width(panel.crop((left, top, left + wide, top + tall)), PANEL) for top, left, tall, wide in boxes]
    height = TITLE + overview.height + sum(GUTTER + detail.height for detail in details)
    column = Image.new("RGB", (PANEL, height), GROUND)
    caption(column, (2, 5), label, size=20)
    column.paste(overview, (0, TITLE))
    pen = ImageDraw.Draw(column)
    y = TITLE + overview.height + GUTTER
    for i, ((top, left, tall, wide), detail) in enumerate(zip(boxes, details, strict=True)):
        colour = MARKS[i % len(MARKS)]
        corners = (left * scale, TITLE + top * scale, (left + wide) * scale, TITLE + (top + tall) * scale)
        pen.rectangle(corners, outline=colour, width=2)
        column.paste(detail, (0, y))
        pen.rectangle((0, y, PANEL - 1, y + detail.height - 1), outline=colour, width=2)
        y += detail.height + GUTTER
    return column


def _to_width(image: Image.Image, width: int) -> Image.Image:
    height = max(round(image.height * width / image.width), 1)
    # Enlarged pixels stay recognisable; reduced ones are averaged well.
    method = Image.Resampling.BICUBIC if width > image.width else Image.Resampling.LANCZOS
    return image.resize((width, height), method)


def _detailed(panels: Mapping[str, Image.Image], count: int) -> list[Box]:
    """Return `count` boxes of 4:3, from top to bottom, where the pictures have most detail."""
    width, height = next(iter(panels.values())).size
    tall = max(min(height, round(0.75 * width)) // 4, min(height, 16))
    wide = min(round(tall * 4 / 3), width)
    energy = sum(_gradient(panel) for panel in panels.values())
    table = np.pad(np.cumsum(np.cumsum(energy, axis=0), axis=1), ((1, 0), (1, 0)))
    # Sum over every box from the summed-area table; the entry is the box's upper left corner.
    sums = table[tall:, wide:] - table[:-tall, wide:] - table[tall:, :-wide] + table[:-tall, :-wide]
    edge = min(BORDER, height // 16, (width - wide) // 2)
    boxes = []
    for i in range(count):
        # A box lies wholly in its part of the height, unless the box is taller than the part.
        part = (height - 2 * edge) / count
        first = min(round(edge + i * part), height - tall)
        last = max(round(edge + (i + 1) * part) - tall + 1, first + 1)
        inside = sums[first:last, edge : width - wide - edge + 1]
        y, x = np.unravel_index(np.argmax(inside), inside.shape)
        boxes.append((int(y) + first, int(x) + edge, tall, wide))
    return boxes


def _gradient(panel: Image.Image) -> FloatArray:
    grey = np.asarray(panel.convert("L"), dtype=np.float64)
    gy, gx = np.gradient(grey) if min(grey.shape) > 1 else (np.zeros_like(grey), np.zeros_like(grey))
    # The square root keeps one hard edge from outweighing fine print.
    return np.sqrt(np.hypot(gx, gy))
