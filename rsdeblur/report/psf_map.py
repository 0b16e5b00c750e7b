"""Map of PSFs: the kernels of a bank, drawn at their places in the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rsdeblur.errors import InputError
from rsdeblur.report._draw import GROUND, MARKS, caption, display, rgb8
from rsdeblur.types import FloatArray, FloatImage

if TYPE_CHECKING:
    from rsdeblur.psf import PsfBank

LONG_SIDE = 1600  # px of the drawing
FOOTER = 40  # px below it, for the caption
SMALLEST_CELL = 40  # px per kernel
MAGNIFIED = 2.0  # least magnification of kernels; some are left out to make room for it
FEWEST = 6  # rows or columns of kernels that are shown even if that leaves less room
LARGEST_ZOOM = 12.0
DIM = 0.4  # brightness left to the picture below the kernels

# Share of a kernel's peak below which values are invisible and get no room.
VISIBLE = 1e-3


def psf_map(bank: PsfBank, shape: tuple[int, ...], *, picture: NDArray[np.floating] | None = None) -> FloatImage:
    """Draw the kernels of `bank` at their places in the picture.

    All kernels are enlarged (or reduced) by one factor, so that the closest two just fit; each is brightened to its own
    peak. Crosses mark the places. Where these are too close, only every n-th kernel is drawn, and the caption says so.

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
    height, width = shape[:2]
    if picture is not None and picture.shape[:2] != (height, width):
        raise InputError(f"picture must have shape {(height, width)} like the one deblurred, got {picture.shape[:2]}")
    scale = LONG_SIDE / max(height, width)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    canvas = Image.new("RGB", size, GROUND)
    if picture is not None:
        grey = rgb8("picture", picture).convert("L").convert("RGB")
        canvas = grey.resize(size, Image.Resampling.BICUBIC).point(lambda value: value * DIM)
    kernels = visible_part(np.asarray(bank.kernels, dtype=np.float64))
    y, x = (np.asarray(bank.rows) + 0.5) * scale, (np.asarray(bank.cols) + 0.5) * scale
    every, across = (
        _stride(places, max(SMALLEST_CELL, MAGNIFIED * scale * side))
        for places, side in zip((y, x), kernels.shape[2:], strict=True)
    )
    cell = (_spacing(y[::every], size[1]), _spacing(x[::across], size[0]))
    zoom = min(0.94 * cell[0] / kernels.shape[2], 0.94 * cell[1] / kernels.shape[3], LARGEST_ZOOM)
    drawing = display(canvas)
    bands, strips = slice(every // 2, None, every), slice(across // 2, None, across)
    for band, top in zip(kernels[bands], y[bands], strict=True):
        for kernel, left in zip(band[strips], x[strips], strict=True):
            _lay(drawing, _enlarged(kernel, zoom), (top, left))
    return _finished(drawing, y[bands], x[strips], _caption(bank, zoom / scale, every, across))


def visible_part(kernels: FloatArray) -> FloatArray:
    """Cut all kernels to the smallest common size that keeps their visible values, with the origin in the middle."""
    seen = (kernels > VISIBLE * kernels.max(axis=(2, 3), keepdims=True)).any(axis=(0, 1))
    middle = np.array(seen.shape) // 2
    # One pixel of margin lets the glow fade out where it is enlarged.
    reach = np.abs(np.argwhere(seen) - middle).max(axis=0) + 1
    padded = np.pad(kernels, ((0, 0), (0, 0), (1, 1), (1, 1)))
    top, left = middle + 1 - reach
    bottom, right = middle + 2 + reach
    return padded[:, :, top:bottom, left:right]


def evenly(count: int, most: int) -> NDArray[np.intp]:
    """Return the indices of at most `most` of `count` places, spread evenly from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))


def _spacing(places: FloatArray, whole: int) -> float:
    return float(np.diff(places).min()) if len(places) > 1 else float(whole)


def _stride(places: FloatArray, room: float) -> int:
    """Return the least n for which every n-th place has `room`, but at most one that leaves `FEWEST` places."""
    stride = int(np.ceil(room / float(np.diff(places).min()))) if len(places) > 1 else 1
    return max(1, min(stride, len(places) // FEWEST))


def _enlarged(kernel: FloatArray, zoom: float) -> FloatArray:
    size = tuple(max(round(side * zoom), 1) for side in reversed(kernel.shape))
    image = Image.fromarray((kernel / max(float(kernel.max()), 1e-30)).astype(np.float32))
    enlarged = np.asarray(image.resize(size, Image.Resampling.BICUBIC), dtype=np.float64)
    return np.clip(enlarged / max(float(enlarged.max()), 1e-30), 0.0, 1.0)


def _lay(drawing: FloatImage, kernel: FloatArray, place: tuple[float, float]) -> None:
    """Lay a kernel (peak 1) over `drawing`, centred on `place`, glowing from dark red over orange to white."""
    tall, wide = kernel.shape
    top, left = round(place[0] - tall / 2), round(place[1] - wide / 2)
    # Kernels near the picture's edge may stick out.
    y0, x0 = max(top, 0), max(left, 0)
    y1, x1 = min(top + tall, drawing.shape[0]), min(left + wide, drawing.shape[1])
    glow = kernel[y0 - top : y1 - top, x0 - left : x1 - left, None]
    colour = np.concatenate([np.minimum(1.6 * glow**0.5, 1.0), glow**0.9, glow**2.2], axis=2)
    part = drawing[y0:y1, x0:x1]
    part += (colour - part) * np.minimum(2.0 * glow**0.5, 1.0)


def _finished(drawing: FloatImage, y: FloatArray, x: FloatArray, text: str) -> FloatImage:
    """Mark the places with small crosses and add the footer."""
    height, width = drawing.shape[:2]
    image = Image.new("RGB", (width, height + FOOTER), GROUND)
    image.paste(rgb8("drawing", drawing))
    pen, arm = ImageDraw.Draw(image), 2
    for py in y.tolist():
        for px in x.tolist():
            pen.line((px - arm, py, px + arm, py), fill=MARKS[1])
            pen.line((px, py - arm, px, py + arm), fill=MARKS[1])
    caption(image, (12, height + 9), text, size=18)
    return display(image)


def _caption(bank: PsfBank, magnified: float, every: int, across: int) -> str:
    rows, cols, tall, wide = bank.kernels.shape
    # Not bands x strips: with a horizontal readout the bands are columns.
    grid = f"{rows} row{'s' * (rows > 1)} x {cols} column{'s' * (cols > 1)} of kernels"
    text = f"{grid} of {wide} x {tall} px, drawn {magnified:.2g} times as large as in the picture"
    thinned = [f"1 of {n} {lines}" for n, lines in ((every, "rows"), (across, "columns")) if n > 1]
    return text + (f"; {' and '.join(thinned)} shown" if thinned else "")
