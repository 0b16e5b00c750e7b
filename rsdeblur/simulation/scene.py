"""A procedural test picture: a bookcase by lamplight, sharp at every scale and free of copyright."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.ImageColor import getrgb

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.image.transfer import to_linear
from rsdeblur.types import FloatImage

Box = tuple[int, int, int, int]

# Smallest width and height, px.
SMALLEST = 64
# Most pixels: they take some 10 GB.
MOST_PIXELS = 100_000_000

# Subpixels along a pixel's edge.
SUBPIXELS = 3

# Colours in sRGB. Lamplight is added later, in linear light.
WALL, WOOD, WOOD_EDGE = "#baaa94", "#7c5232", "#966842"
PAPER, INK, GOLD = "#eee8d8", "#1c1a1e", "#d6b260"
CLOTH = (
    "#8e2622", "#1e3e62", "#26543e", "#c48e34", "#583458",
    "#d8ccb2", "#3a383c", "#ae542c", "#407684", "#707846",
)  # fmt: skip
SUBJECTS = (
    "LIGHT", "OPTICS", "SHADOWS", "MOTION", "GLASS", "RIVERS", "STONES", "WINTER", "MAPS", "TIME", "COLOUR", "WAVES",
    "GARDENS", "CLOUDS", "HARBOURS", "NUMBERS", "SILENCE", "TREES", "SALT", "WIND",
)  # fmt: skip
TITLES = (
    "A HISTORY OF {}", "{} & {}", "THE BOOK OF {}", "ON {}", "NOTES ON {}", "{}", "ESSAYS: {}", "{} AND OTHER STORIES",
    "COLLECTED {}", "LETTERS ABOUT {}",
)  # fmt: skip
AUTHORS = ("ARNOLD", "BELL", "CORTEZ", "DUVAL", "ERIKSEN", "FONTANA", "GREY", "HOLM", "IVANOVA", "JANSEN", "KIM", "LO")


class _Canvas(NamedTuple):
    """The drawing in subpixels, its pen, its height as the unit of length, and a generator of random numbers."""

    image: Image.Image
    pen: ImageDraw.ImageDraw
    unit: float
    random: np.random.Generator


def scene(height: int, width: int, *, seed: int = 0) -> FloatImage:
    """Return a picture of a bookcase: spines with titles, a Siemens star, fine print, wood and lamplight.

    Every pixel is the mean of several subpixels in linear light, so edges are antialiased as by a lens and a sensor.
    Objects scale with the height; a wider picture shows more books.

    Parameters
    ----------
    height, width : int
        Size in px, each at least 64.
    seed : int, default 0
        Seed of the books, their colours and the texture; at least 0.

    Returns
    -------
    ndarray, shape (height, width, 3), float32
        Linear light in [0, 1]; :func:`rsdeblur.image.transfer.from_linear` encodes it for display.

    Raises
    ------
    InputError
        If an argument is out of its range.

    Examples
    --------
    >>> import rsdeblur
    >>> picture = rsdeblur.scene(64, 64)
    >>> picture.shape, picture.dtype
    ((64, 64, 3), dtype('float32'))
    """
    height = validate.count("height", height, minimum=SMALLEST, maximum=MOST_PIXELS)
    width = validate.count("width", width, minimum=SMALLEST, maximum=MOST_PIXELS)
    if height * width > MOST_PIXELS:
        raise InputError(f"a scene has at most {MOST_PIXELS} pixels, got {height} x {width}")
    random = np.random.default_rng(validate.count("seed", seed, minimum=0))
    image = Image.new("RGB", (width * SUBPIXELS, height * SUBPIXELS), WALL)
    canvas = _Canvas(image, ImageDraw.Draw(image), float(height * SUBPIXELS), random)
    for top, bottom in ((-0.16, 0.28), (0.32, 0.635), (0.675, 0.955)):
        _shelf(canvas, top, bottom)
    _still_life(canvas)
    light = _linear_mean(image)
    light *= _texture(height, width, random)
    light *= _lamplight(height, width)
    return np.clip(light, 0.0, 1.0, out=light)


def _shelf(canvas: _Canvas, top: float, bottom: float) -> None:
    """Draw a board, whose upper edge is at `bottom`, with books on it; heights are fractions of the picture's."""
    image, pen, unit, random = canvas
    floor = round(bottom * unit)
    thick = round(0.04 * unit)
    pen.rectangle((0, floor, image.width, floor + thick), fill=WOOD)
    _grain(canvas, (0, floor, image.width, floor + thick))
    pen.rectangle((0, floor, image.width, floor + max(thick // 10, 1)), fill=WOOD_EDGE)
    x = -random.random() * 0.03 * unit
    while x < image.width:
        wide = round(unit * random.uniform(0.022, 0.062))
        tall = round(unit * (bottom - max(top, 0.0)) * random.uniform(0.72, 0.95)) + round(unit * max(-top, 0.0))
        book = _book(canvas, wide, tall)
        if random.random() < 0.12:
            angle = random.uniform(5.0, 9.0)
            cut = book.convert("RGBA").rotate(angle, Image.Resampling.BICUBIC, expand=True)
            image.paste(cut, (round(x), floor - cut.height + 1), cut)
            x += cut.width
        else:
            image.paste(book, (round(x), floor - tall))
            x += wide + random.choice((0.0, 0.0, 0.002, 0.02), p=(0.5, 0.2, 0.2, 0.1)) * unit


def _book(canvas: _Canvas, wide: int, tall: int) -> Image.Image:
    """Return one spine: cloth with shading, printed bands, a title along it and an author across it."""
    random = canvas.random
    cloth = np.array(getrgb(CLOTH[random.integers(len(CLOTH))])) * random.uniform(0.85, 1.1)
    dark = cloth.mean() < 130
    across = np.linspace(-1.0, 1.0, wide)
    shade = 0.45 + 0.6 * np.sqrt(1.0 - 0.9 * across**2) * (1.0 - 0.18 * across)
    weave = 1.0 + 0.05 * random.standard_normal((tall, wide))
    pixels = np.clip(cloth * (shade * weave)[..., None], 0, 255).astype(np.uint8)
    book = Image.fromarray(pixels)
    pen = ImageDraw.Draw(book)
    print_colour = (GOLD if random.random() < 0.5 else PAPER) if dark else INK
    rule = max(round(0.0022 * canvas.unit), 1)
    for part in random.choice((0.04, 0.055, 0.14, 0.83, 0.93, 0.945), size=3, replace=False):
        pen.line((0, part * tall, wide, part * tall), fill=print_colour, width=rule)
    subjects = iter(random.permutation(SUBJECTS))
    title = str(random.choice(TITLES))
    title = title.format(*(next(subjects) for _ in range(title.count("{}"))))
    strip = _fitted(title, round(0.62 * tall), round(0.58 * wide), print_colour)
    strip = strip.rotate(-90, expand=True)
    book.paste(strip, ((wide - strip.width) // 2, round(0.17 * tall)), strip)
    author = _fitted(str(random.choice(AUTHORS)), round(0.8 * wide), round(0.05 * tall), print_colour)
    book.paste(author, ((wide - author.width) // 2, round(0.865 * tall)), author)
    return book


def _fitted(text: str, wide: int, tall: int, colour: str) -> Image.Image:
    """Return `text` on a transparent ground, as large as fits into `wide` x `tall`."""
    size = max(tall, 1)
    font = ImageFont.load_default(size)
    left, top, right, bottom = font.getbbox(text)
    scale = min(wide / max(right - left, 1), tall / max(bottom - top, 1), 1.2)
    font = ImageFont.load_default(max(size * scale, 1.0))
    left, top, right, bottom = font.getbbox(text)
    strip = Image.new("RGBA", (max(round(right - left), 1), max(round(bottom - top), 1)), (*getrgb(colour), 0))
    ImageDraw.Draw(strip).text((-left, -top), text, fill=colour, font=font)
    return strip


def _grain(canvas: _Canvas, box: Box) -> None:
    """Draw wavy lines of darker and lighter wood."""
    left, top, right, bottom = box
    x = np.linspace(left, right, 200)
    for _ in range(14):
        y = canvas.random.uniform(top, bottom)
        swing = 0.1 * (bottom - top) * np.sin(x / canvas.unit * canvas.random.uniform(1.0, 7.0) + y)
        colour = tuple(round(c * canvas.random.uniform(0.75, 1.1)) for c in getrgb(WOOD))
        points = list(zip(x.tolist(), np.clip(y + swing, top, bottom).tolist(), strict=True))
        canvas.pen.line(points, fill=colour, width=max(round(0.0015 * canvas.unit), 1))


def _still_life(canvas: _Canvas) -> None:
    """Draw a framed Siemens star, a page of fine print, a chart of bars and a glazed ball in front of the books."""
    unit, across = canvas.unit, canvas.image.width
    left, top, right, bottom = _card(canvas, (0.06 * across, 0.375 * unit), (0.25 * unit, 0.25 * unit))
    x, y, radius = (left + right) / 2, (top + bottom) / 2, 0.46 * (right - left)
    for spoke in range(36):
        canvas.pen.pieslice(
            (x - radius, y - radius, x + radius, y + radius), spoke * 10.0, (spoke + 0.5) * 10.0, fill=INK
        )
    _fine_print(canvas, _card(canvas, (0.94 * across - 0.25 * unit, 0.70 * unit), (0.25 * unit, 0.245 * unit)))
    _line_pairs(canvas, _card(canvas, (0.56 * across - 0.12 * unit, 0.10 * unit), (0.24 * unit, 0.17 * unit)))
    _ball(canvas, (0.8 * across, 0.635 * unit), 0.07 * unit)


def _card(canvas: _Canvas, corner: tuple[float, float], size: tuple[float, float]) -> Box:
    """Draw a framed sheet of paper and return the box inside its frame."""
    left, top = map(round, corner)
    right, bottom = left + round(size[0]), top + round(size[1])
    frame = max(round(0.012 * canvas.unit), 1)
    canvas.pen.rectangle((left + frame // 2, top + frame // 2, right + frame // 2, bottom), fill=(40, 30, 24))
    canvas.pen.rectangle((left, top, right, bottom), fill=(66, 44, 30))
    canvas.pen.rectangle((left, top, right, top + frame // 4), fill=WOOD_EDGE)
    box = (left + frame, top + frame, right - frame, bottom - frame)
    canvas.pen.rectangle(box, fill=PAPER)
    return box


def _fine_print(canvas: _Canvas, box: Box) -> None:
    """Fill `box` with lines of text of decreasing size."""
    left, top, right, bottom = box
    size = 0.15 * (bottom - top)
    y = top + 0.04 * (bottom - top)
    while y + 1.3 * size < bottom and size > 2.0:
        words = canvas.random.choice(SUBJECTS, size=40).tolist()
        font = ImageFont.load_default(size)
        while font.getlength(line := " ".join(words).capitalize()) > 0.92 * (right - left) and len(words) > 1:
            words.pop()
        canvas.pen.text((left + 0.05 * (right - left), y), line, fill=INK, font=font)
        y += 1.25 * size
        size *= 0.86


def _line_pairs(canvas: _Canvas, box: Box) -> None:
    """Fill `box` with rows of vertical bars, each row finer than the last, and patches of colour below."""
    left, top, right, bottom = box
    wide, tall = right - left, bottom - top
    for row, pairs in enumerate((6, 12, 24, 48)):
        y0, y1 = top + (0.06 + 0.17 * row) * tall, top + (0.19 + 0.17 * row) * tall
        pitch = 0.9 * wide / pairs
        for i in range(pairs):
            x = left + 0.05 * wide + i * pitch
            canvas.pen.rectangle((x, y0, x + 0.5 * pitch, y1), fill=INK)
    for i, colour in enumerate(CLOTH[:6]):
        x = left + (0.05 + 0.15 * i) * wide
        canvas.pen.rectangle((x, top + 0.77 * tall, x + 0.15 * wide, top + 0.94 * tall), fill=colour)


def _ball(canvas: _Canvas, foot: tuple[float, float], radius: float) -> None:
    """Draw a glazed ball, a smooth gradient with two highlights, whose lowest point is at `foot`."""
    size = round(2 * radius)
    y, x = np.mgrid[-1.0 : 1.0 : size * 1j, -1.0 : 1.0 : size * 1j]
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    diffuse = 0.25 + 0.75 * np.maximum(-0.5 * x - 0.5 * y + 0.7 * z, 0.0)
    shine = np.exp(-((x + 0.38) ** 2 + (y + 0.4) ** 2) / 0.012)
    shine += 0.35 * np.exp(-((x - 0.5) ** 2 + (y - 0.45) ** 2) / 0.03)
    pixels = np.clip(np.array(getrgb(CLOTH[8])) * diffuse[..., None] + 230.0 * shine[..., None], 0, 255)
    mask = Image.fromarray(np.where(x**2 + y**2 <= 1.0, 255, 0).astype(np.uint8))
    ball = Image.fromarray(pixels.astype(np.uint8))
    canvas.image.paste(ball, (round(foot[0] - radius), round(foot[1]) - size), mask)


def _linear_mean(image: Image.Image) -> FloatImage:
    """Return the mean light of the subpixels of each pixel of an sRGB picture."""
    linear = to_linear(np.linspace(0.0, 1.0, 256, dtype=np.float32), "srgb")
    drawn = np.asarray(image)
    light = np.zeros((image.height // SUBPIXELS, image.width // SUBPIXELS, 3), np.float32)
    for dy, dx in np.ndindex(SUBPIXELS, SUBPIXELS):
        light += linear[drawn[dy::SUBPIXELS, dx::SUBPIXELS]]
    light /= SUBPIXELS**2
    return light


def _texture(height: int, width: int, random: np.random.Generator) -> FloatImage:
    """Return 1/f noise around 1, like the texture of natural surfaces; shape (height, width, 1)."""
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :]
    radius = np.hypot(fy, fx)
    # Flat below 4 cycles per height: at that scale, the lamp sets the brightness.
    spectrum = np.fft.rfft2(random.standard_normal((height, width))) / np.maximum(radius, 4.0 / height)
    noise = np.fft.irfft2(spectrum, s=(height, width))
    values: FloatImage = (1.0 + 0.07 * noise / noise.std())[..., None].astype(np.float32)
    return values


def _lamplight(height: int, width: int) -> FloatImage:
    """Return the light on the scene: a warm pool, cool fill light and shadows below the boards."""
    y = ((np.arange(height) + 0.5) / height)[:, None]
    x = ((np.arange(width) + 0.5) / height)[None, :]
    middle = 0.5 * width / height
    pool = np.exp(-(((x - middle * 0.8) / (0.9 * middle + 0.2)) ** 2) - ((y - 0.45) / 0.62) ** 2)
    light = 0.18 + 1.25 * pool[..., None] * np.array([1.0, 0.86, 0.66]) + 0.12 * np.array([0.5, 0.7, 1.0])
    for board in (0.32, 0.675):
        depth = (y - board) / 0.05
        light *= np.where(depth > 0, 1.0 - 0.65 * np.exp(-depth), 1.0)[..., None]
    values: FloatImage = light.astype(np.float32)
    return values
