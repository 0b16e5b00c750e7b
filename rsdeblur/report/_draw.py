"""Helpers of all drawings: 8-bit pictures, and captions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rsdeblur.errors import InputError
from rsdeblur.types import FloatImage

Colour = tuple[int, int, int]

GROUND: Colour = (24, 25, 28)
TEXT: Colour = (232, 232, 228)
MARKS: tuple[Colour, ...] = ((255, 176, 59), (94, 206, 255), (148, 232, 128), (255, 128, 160), (200, 160, 255))


def rgb8(name: str, image: NDArray[np.floating]) -> Image.Image:
    """Return display values in [0, 1], grey or RGB, as an 8-bit RGB picture; alpha is left out.

    Raises
    ------
    InputError
        If `image` does not have the shape of a picture; the message calls it `name`.
    """
    values = np.asarray(image)
    if values.ndim == 2:
        values = values[..., None]
    if values.ndim != 3 or values.shape[2] not in (1, 2, 3, 4) or not values.size:
        raise InputError(f"{name} must be a picture of shape (H, W) or (H, W, C), got {np.shape(image)}")
    colours = values[..., :3] if values.shape[2] >= 3 else np.repeat(values[..., :1], 3, axis=2)
    return Image.fromarray(np.round(np.clip(colours, 0.0, 1.0) * 255.0).astype(np.uint8))


def display(image: Image.Image) -> FloatImage:
    """Return an 8-bit picture as display values in [0, 1]."""
    return np.asarray(image, dtype=np.float32) / np.float32(255.0)


def caption(image: Image.Image, corner: tuple[int, int], text: str, *, size: int) -> None:
    """Write `text` with its upper left corner at `corner`."""
    ImageDraw.Draw(image).text(corner, text, fill=TEXT, font=ImageFont.load_default(size))
