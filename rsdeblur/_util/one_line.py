"""Representations of one line, for objects whose arrays would fill the screen."""

import base64
import html
import inspect
import numbers
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Class = TypeVar("Class", bound=type)

# Arrays of at most this many values are shown, longer ones by type and shape.
FEW = 4
LONGEST_TEXT = 60
# Longer side of a picture in a notebook, px: two stand beside each other.
SIDE = 480


def one_line(*names: str) -> Callable[[Class], Class]:
    """Return a class decorator that makes `repr` one line: the class with the attributes `names`.

    Without names, these are the constructor's arguments that are attributes too; those at their default, and fields
    with ``repr=False``, are left out. An underscore in front of a name is not shown.
    """

    def decorate(cls: Class) -> Class:
        def representation(self: Any) -> str:
            shown = {name: getattr(self, name) for name in names} if names else _arguments(self)
            parts = [f"{name.lstrip('_')}={brief(value)}" for name, value in shown.items()]
            return f"{type(self).__name__}({', '.join(parts)})"

        cls.__repr__ = representation  # type: ignore[method-assign, assignment]
        return cls

    return decorate


def _arguments(thing: Any) -> dict[str, Any]:
    """Return the arguments of the constructor that are attributes and differ from their default."""
    fields, shown = getattr(thing, "__dataclass_fields__", {}), {}
    for name, each in inspect.signature(type(thing)).parameters.items():
        value = getattr(thing, name, each.default)
        if (name not in fields or fields[name].repr) and (isinstance(value, np.ndarray) or value != each.default):
            shown[name] = value
    return shown


def brief(value: Any) -> str:
    """Return a short text for a value; numbers are rounded to six digits."""
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= FEW:
            return brief(value.tolist())
        return f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    if isinstance(value, numbers.Real) and not isinstance(value, numbers.Integral):
        return f"{float(value):.6g}"
    if isinstance(value, (tuple, list)):
        inner = ", ".join(map(brief, value[:FEW])) + ", ..." * (len(value) > FEW)
        return f"[{inner}]" if isinstance(value, list) else f"({inner}{',' * (len(value) == 1)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(map(str, value)) + "}"
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    text = repr(value)
    if len(text) > LONGEST_TEXT or "\n" in text:
        return f"{text[:LONGEST_TEXT]}...{text[-1]}" if isinstance(value, str) else f"{type(value).__name__}(...)"
    return text


def html_with_pictures(thing: object, pictures: Mapping[str, NDArray[np.floating]]) -> str:
    """Return HTML for a notebook: the representation, and pictures of sRGB values in [0, 1] with their names."""
    figures = "".join(map(_figure, pictures, pictures.values()))
    style = "display: flex; flex-wrap: wrap; gap: 8px"
    return f'<div><code>{html.escape(repr(thing))}</code><div style="{style}">{figures}</div></div>'


def _figure(name: str, picture: NDArray[np.floating]) -> str:
    from PIL import Image

    buffer = BytesIO()
    image = Image.fromarray(np.round(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8))
    image.thumbnail((SIDE, SIDE))
    image.save(buffer, "PNG")
    uri = f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
    # Small pictures are enlarged by a whole number.
    width, style = SIDE // max(image.size) * image.width, "max-width: 100%; image-rendering: pixelated"
    return (
        f'<figure style="margin: 0"><figcaption>{name}</figcaption>'
        f'<img alt="{name}" width="{width}" style="{style}" src="{uri}"></figure>'
    )
