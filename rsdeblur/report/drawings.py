"""Drawings: with Pillow pictures in 8 bits, kernels at their places, data for pages; as SVG the blur over time."""

import base64
import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from rsdeblur.errors import InputError
from rsdeblur.motion.triage import DECISIONS, Triage
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

Display = NDArray[np.floating]
Colour = tuple[int, int, int]
Box = tuple[int, int, int, int]

GROUND: Colour = (24, 25, 28)
MARKS: tuple[Colour, ...] = ((255, 176, 59), (94, 206, 255), (148, 232, 128))
DIM = 0.4  # brightness left to a picture below kernels
# px: width of a picture in a grid, space between two, and height of a line of text.
PANEL, GUTTER, TITLE = 560, 10, 34
LONG_SIDE = 1600  # px of a map of PSFs
MOST = 12, 9  # rows and columns of kernels in one drawing; more would have no room
# Pixels of a picture, for which a browser needs four bytes of memory each, and of all of a page, whose file has about a
# byte for each.
MOST_PIXELS, PAGE_PIXELS = 8e6, 12e6
LEAST = 0.1  # px, where the logarithmic axis starts; shorter paths are drawn there
COLOURS: dict[str, str] = dict(zip(DECISIONS, ("#2a9d5c", "#2b7bba", "#c8443c", "#8a8a8a"), strict=True))
# The colours of a page, which `page.css` lists.
STYLE = (
    "text{font:12px system-ui,sans-serif;fill:#1d2126}.ground{fill:#fbfaf7}.frame{fill:none;stroke:#5b6470}"
    ".grid{stroke:#dcdad3}.limit{stroke:#1d2126;stroke-dasharray:5 4}@media(prefers-color-scheme:dark){"
    "text{fill:#e6e4df}.ground{fill:#15171a}.frame{stroke:#a2a9b3}.grid{stroke:#363b42}.limit{stroke:#e6e4df}}"
)


def rgb8(name: str, image: Display) -> Image.Image:
    """Return display values in [0, 1], called `name` in messages, as an 8-bit RGB picture without alpha."""
    values = np.asarray(image)
    if values.ndim == 2:
        values = values[..., None]
    if values.ndim != 3 or values.shape[2] not in (1, 2, 3, 4) or not values.size:
        raise InputError(f"{name} must be a picture of shape (H, W) or (H, W, C), got {np.shape(image)}")
    colours = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    return Image.fromarray(np.round(np.clip(colours, 0.0, 1.0) * 255.0).astype(np.uint8))


def _display(image: Image.Image) -> FloatImage:
    return np.asarray(image, dtype=np.float32) / np.float32(255.0)


def _caption(image: Image.Image, corner: tuple[int, int], text: str) -> None:
    ImageDraw.Draw(image).text(corner, text, fill=(232, 232, 228), font=ImageFont.load_default(18))


def _to_width(image: Image.Image, width: int) -> Image.Image:
    height = max(round(image.height * width / image.width), 1)
    # Enlarged pixels stay recognisable; reduced ones are averaged well.
    method = Image.Resampling.BICUBIC if width > image.width else Image.Resampling.LANCZOS
    return image.resize((width, height), method)


def side_by_side(images: Mapping[str, Display]) -> FloatImage:
    """Lay labelled pictures side by side, and below each the same details enlarged.

    Parameters
    ----------
    images : mapping of str to ndarray
        Display values in [0, 1], grey or RGB, all of one height and width; the keys are the labels. The box with most
        detail is chosen in each third of the height.

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        Display values in [0, 1].

    Raises
    ------
    InputError
        If the sizes differ.
    """
    panels = {label: rgb8(f"picture {label!r}", image) for label, image in images.items()}
    if len({panel.size for panel in panels.values()}) > 1:
        sizes = ", ".join(f"{label!r} has {panel.width}x{panel.height} px" for label, panel in panels.items())
        raise InputError(f"pictures side by side need one size: {sizes}")
    boxes = _detailed(list(panels.values()))
    columns = [_with_details(panel, boxes) for panel in panels.values()]
    across, down = columns[0].width + GUTTER, columns[0].height + TITLE + 2 * GUTTER
    sheet = Image.new("RGB", (len(columns) * across + GUTTER, down), GROUND)
    for i, (label, column) in enumerate(zip(panels, columns, strict=True)):
        _caption(sheet, (GUTTER + i * across + 2, 6), label)
        sheet.paste(column, (GUTTER + i * across, TITLE))
    return _display(sheet)


def _with_details(panel: Image.Image, boxes: Sequence[Box]) -> Image.Image:
    """Return a picture with frames around its details, and the details below it."""
    parts = [_to_width(part, PANEL) for part in (panel, *(panel.crop(box) for box in boxes))]
    column = Image.new("RGB", (PANEL, sum(part.height + GUTTER for part in parts) - GUTTER), GROUND)
    pen, y = ImageDraw.Draw(column), 0
    for i, part in enumerate(parts):
        column.paste(part, (0, y))
        if i:
            corners = tuple(PANEL / panel.width * place for place in boxes[i - 1])
            for frame in (corners, (0, y, PANEL - 1, y + part.height - 1)):
                pen.rectangle(frame, outline=MARKS[i - 1], width=2)
        y += part.height + GUTTER
    return column


def _detailed(panels: Sequence[Image.Image]) -> list[Box]:
    """Return boxes of 4:3, one for each of `MARKS` from top to bottom, where the pictures have most detail."""
    width, height = panels[0].size
    tall = max(min(height, round(0.75 * width)) // 4, min(height, 16))
    wide = min(round(tall * 4 / 3), width)
    # The square root keeps one hard edge from outweighing fine print.
    greys = (np.asarray(panel.convert("L"), dtype=np.float64) for panel in panels)
    detail = np.sum([np.sqrt(ndimage.gaussian_gradient_magnitude(grey, 1)) for grey in greys], axis=0)
    means = ndimage.uniform_filter(detail, (tall, wide))
    # Of the boxes whose corner is at a place, where they fit.
    means = np.roll(means, (-(tall // 2), -(wide // 2)), (0, 1))[: height - tall + 1, : width - wide + 1]
    boxes, count = [], len(MARKS)
    for i in range(count):
        # A box lies wholly in its part of the height, unless it is taller than that.
        first = min(i * height // count, height - tall)
        part = means[first : max((i + 1) * height // count - tall, first) + 1]
        top, left = map(int, np.unravel_index(np.argmax(part), part.shape))
        boxes.append((left, first + top, left + wide, first + top + tall))
    return boxes


def trails(bank: PsfBank) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return rows and columns in px of an even selection of kernels, and these, brightened to their peaks of 1."""
    down, across = map(thinned, bank.kernels.shape[:2], MOST)
    kernels = np.asarray(bank.kernels[down, across], dtype=np.float64)
    shares = kernels / np.maximum(kernels.max(axis=(2, 3), keepdims=True), 1e-30)
    # The square root makes faint parts of a trail visible.
    return np.asarray(bank.rows)[down], np.asarray(bank.cols)[across], np.sqrt(shares.clip(0.0, 1.0))


def thinned(count: int, most: int) -> slice:
    """Return a slice that takes at most `most` of `count` things, evenly spaced."""
    every = -(-count // most)
    return slice((count - 1) % every // 2, None, every)


def fitting(rows: FloatArray, cols: FloatArray, size: Sequence[float], shape: tuple[int, ...]) -> float:
    """Return the factor by which things of `size` fill the room between two places of a picture of this shape."""
    rooms = (
        np.diff(places).min() if len(places) > 1 else whole
        for places, whole in zip((rows, cols), shape[:2], strict=True)
    )
    return 0.94 * min(float(room) / side for room, side in zip(rooms, size, strict=True))


def psf_map(bank: PsfBank, shape: tuple[int, ...], *, picture: Display | None = None) -> FloatImage:
    """Draw the kernels of `bank` at their places in the picture, with a caption.

    All kernels are enlarged (or reduced) by one factor, so that the closest two just fit; each is brightened to its own
    peak. Crosses mark the places. Of many kernels an even selection is drawn, and the caption says so.

    Parameters
    ----------
    bank : PsfBank
        Kernels and their places.
    shape : tuple
        Shape of the picture, (H, W, ...).
    picture : ndarray, optional
        Display values in [0, 1], grey or RGB, shown dimmed below the kernels.

    Returns
    -------
    ndarray, shape (h, w, 3), float32
        Display values in [0, 1]; the longer side of the picture becomes 1600 px.

    Raises
    ------
    InputError
        If `picture` does not have that height and width, or not the shape of a picture.
    """
    if picture is not None and picture.shape[:2] != tuple(shape[:2]):
        raise InputError(f"picture must have shape {shape[:2]} like the one deblurred, got {picture.shape[:2]}")
    scale = LONG_SIDE / max(shape[:2])
    width, height = (max(round(side * scale), 1) for side in (shape[1], shape[0]))
    drawing = Image.new("RGB", (width, height), GROUND)
    if picture is not None:
        grey = rgb8("picture", picture).convert("L").resize((width, height), Image.Resampling.BICUBIC)
        drawing.paste(grey.point(lambda value: value * DIM).convert("RGB"))
    rows, cols, kernels = trails(bank)
    zoom = min(fitting(rows, cols, kernels.shape[2:], shape) * scale, 12.0)
    places = [((row + 0.5) * scale, (col + 0.5) * scale) for row in rows for col in cols]
    for kernel, place in zip(kernels.reshape(-1, *kernels.shape[2:]), places, strict=True):
        _lay(drawing, kernel, zoom, place)
    pen = ImageDraw.Draw(drawing)
    for y, x in places:
        pen.line((x - 2, y, x + 2, y), fill=MARKS[1])
        pen.line((x, y - 2, x, y + 2), fill=MARKS[1])
    # Not bands x strips: with a horizontal readout the bands are columns.
    (down, across), (tall, wide) = bank.kernels.shape[:2], bank.size
    text = f"{len(rows)} x {len(cols)} of {down} x {across} kernels (rows x columns) of {wide} x {tall} px, drawn "
    text += f"{zoom / scale:.2g} times as large as in the picture"
    sheet = Image.new("RGB", (drawing.width, drawing.height + TITLE), GROUND)
    sheet.paste(drawing)
    _caption(sheet, (GUTTER, drawing.height + GUTTER // 2), text)
    return _display(sheet)


def _lay(drawing: Image.Image, kernel: FloatArray, zoom: float, place: tuple[float, float]) -> None:
    """Lay a kernel of peak 1 over `drawing`, centred on `place`, glowing from dark red over orange to white."""
    size = max(round(kernel.shape[1] * zoom), 1), max(round(kernel.shape[0] * zoom), 1)
    enlarged = np.asarray(Image.fromarray(kernel.astype(np.float32)).resize(size, Image.Resampling.BICUBIC))
    glow = np.clip(enlarged / max(float(enlarged.max()), 1e-30), 0.0, 1.0)
    colours = rgb8("kernel", np.stack([1.6 * glow, glow**1.8, glow**4.4], axis=2))
    mask = rgb8("kernel", 2.0 * glow).convert("L")
    drawing.paste(colours, (round(place[1] - size[0] / 2), round(place[0] - size[1] / 2)), mask)


def picture_uris(pictures: Mapping[str, Display], icc_profile: bytes | None) -> tuple[list[str], float]:
    """Return pictures of one size as data URIs of JPEG, all reduced to the pixels of a page, and the factor, <= 1."""
    images = [rgb8(label, picture) for label, picture in pictures.items()]
    pixels = images[0].width * images[0].height
    scale = math.sqrt(min(1.0, MOST_PIXELS / pixels, PAGE_PIXELS / (pixels * len(images))))
    size = max(round(images[0].width * scale), 1), max(round(images[0].height * scale), 1)
    reduced = (image if scale == 1.0 else image.resize(size, Image.Resampling.LANCZOS) for image in images)
    return [_uri(image, subsampling=0, icc_profile=icc_profile or b"") for image in reduced], scale


def bank_data(bank: PsfBank) -> dict[str, Any]:
    """Return an evenly spaced selection of the kernels as one grey picture, with their places, for a page."""
    rows, cols, kernels = trails(bank)
    down, across, tall, wide = kernels.shape
    atlas = rgb8("kernels", kernels.transpose(0, 2, 1, 3).reshape(down * tall, across * wide)).convert("L")
    return {
        "rows": np.round(rows, 2).tolist(),
        "cols": np.round(cols, 2).tolist(),
        "kernel": [wide, tall],
        "of": list(bank.kernels.shape[:2]),
        "atlas": _uri(atlas, kind="png", optimize=True),
    }


def _uri(image: Image.Image, *, kind: str = "jpeg", **options: Any) -> str:
    """Encode a picture as a data URI."""
    buffer = BytesIO()
    image.save(buffer, kind, quality=92, **options)
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode()}"


def timeline_svg(times: Sequence[float | None], triage: Triage) -> bytes:
    """Return an SVG file of the blur of exposures over time, in s, None if unknown, coloured by decision."""
    left, top, right, bottom = 56, 34, 944, 316  # of the plot in a drawing of 960 x 360 px
    lengths = np.nan_to_num(triage.lengths, nan=LEAST).clip(LEAST)
    most = 10.0 ** np.ceil(np.log10(max([1.0, 2 * triage.keep, *lengths])))
    known = [time for time in times if time is not None] or [0.0]
    # The first and the last dot are inside the frame.
    ends, inside = (min(known), max(max(known), min(known) + 1e-9)), (left + 10, right - 10)

    def down(length: float) -> float:
        return float(np.interp(np.log10(length), np.log10([LEAST, most]), [bottom, top]))

    def text(x: float, y: float, words: str, anchor: str = "start") -> str:
        return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'

    def line(kind: str, length: float, x: float, rise: float, words: str) -> str:
        path = f'<path class="{kind}" d="M{left} {down(length):.1f}H{right}"/>'
        return path + text(x, down(length) + rise, words, "end")

    def dot(x: float, y: float, r: float, decision: str) -> str:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{COLOURS[decision]}"/>'

    parts = [f'<style>{STYLE}</style><rect class="ground" width="100%" height="100%"/>']
    ticks = 10.0 ** np.arange(np.log10(LEAST), np.log10(most) + 1)
    parts += [line("grid", tick, left - 6, 4, f"{tick:g}") for tick in ticks]
    limits = {f"keep up to {triage.keep:g} px": triage.keep, f"drop above {triage.drop:g} px": triage.drop}
    parts += [line("limit", at, right - 6, -4, words) for words, at in limits.items() if LEAST <= at <= most]
    for time, length, decision in zip(times, lengths, triage.decisions, strict=True):
        if time is not None:
            x, r = float(np.interp(time, ends, inside)), 3.5 if len(known) < 100 else 2.5
            parts.append(dot(x, down(length), r, decision))
    parts.append(f'<path class="frame" d="M{left} {top}H{right}V{bottom}H{left}Z"/>')
    parts += [text(np.interp(t, ends, inside), bottom + 16, f"{t:.3g}", "middle") for t in np.linspace(*ends, 5)]
    parts += [text((left + right) / 2, bottom + 34, "time, s", "middle"), text(8, 20, "longest path, px")]
    for i, decision in enumerate(DECISIONS):
        x, label = left + 140 + 130 * i, f"{decision}: {triage.counts[decision]}"
        parts += [dot(x, 16, 4, decision), text(x + 10, 20, label)]
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 360" width="100%">'
    return f"{head}{''.join(parts)}</svg>\n".encode()
