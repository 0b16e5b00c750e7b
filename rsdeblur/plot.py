"""Plots with Matplotlib (extra ``[plot]``); `rsdeblur.report.psf_map` draws kernels.

Matplotlib is imported at the first call, so its backend can be chosen after this module is imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.burst.burst import BurstResult
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import displayed
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.types import FloatArray

__all__ = ["comparison"]


def comparison(
    pictures: Mapping[str, ArrayLike | DeblurResult | BurstResult],
    *,
    crop: tuple[int, int, int, int] | None = None,
    reference: ArrayLike | DeblurResult | BurstResult | None = None,
    transfer: Transfer | Auto = "auto",
) -> NDArray[Any]:
    """Draw pictures side by side, with their PSNR where the truth is known.

    Parameters
    ----------
    pictures : mapping of str to array_like, DeblurResult or BurstResult
        Pictures of one shape, by title. A result is shown as its own `transfer` says.
    crop : (top, left, height, width), optional
        Part to show, px; default the whole. The PSNR is that of the whole.
    reference : array_like, DeblurResult or BurstResult, optional
        The sharp picture.
    transfer : {"auto", "linear", "srgb"} or float
        How the values of arrays encode light, as for :func:`rsdeblur.deblur`.

    Returns
    -------
    ndarray of matplotlib.axes.Axes
        One for each picture, in a new figure.

    Raises
    ------
    InputError
        If there is no picture, the shapes differ, `crop` shows nothing, Matplotlib is not installed, or `transfer` is
        "auto" for arrays of integers beside arrays of floats, which may be the result of such integers.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur.plot
    >>> grey = np.full((48, 64), 0.5)
    >>> axes = rsdeblur.plot.comparison({"grey": grey, "lighter": 1.1 * grey}, reference=grey)
    >>> [ax.get_title() for ax in axes]
    ['grey', 'lighter, 29.9 dB']
    """
    if not isinstance(pictures, Mapping):
        raise InputError(f"pictures must be a dict of pictures by their titles, got {validate.shown(pictures)}")
    shown = {title: _display(picture, transfer) for title, picture in pictures.items()}
    truth = None if reference is None else _display(reference, transfer)
    _check_transfers([*pictures.values(), *([] if reference is None else [reference])], transfer)
    shapes = {picture.shape for picture in shown.values()} | ({truth.shape} if truth is not None else set())
    if not shown or len(shapes) != 1:
        raise InputError(f"pictures must be at least one and all of one shape, got {sorted(shapes) or 'none'}")
    height, width = shapes.pop()[:2]
    top, left, tall, wide = _checked_crop((0, 0, height, width) if crop is None else crop, height, width)
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise InputError(validate.missing("plots need Matplotlib", "plot")) from None
    _, axes = plt.subplots(
        1, len(shown), squeeze=False, figsize=(3.2 * len(shown), 3.2 * tall / wide + 0.5), layout="constrained"
    )
    for ax, (title, picture) in zip(axes[0], shown.items(), strict=True):
        part = picture[top : top + tall, left : left + wide]
        ax.imshow(part, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
        error = 0.0 if truth is None else float(np.mean((picture - truth) ** 2))
        ax.set_title(f"{title}, {-10 * np.log10(error):.1f} dB" if error else title)
        ax.set_axis_off()
    row: NDArray[Any] = axes[0]
    return row


def _check_transfers(pictures: Iterable[ArrayLike | DeblurResult | BurstResult], transfer: Transfer | Auto) -> None:
    """Refuse arrays that would be decoded in two ways."""
    arrays = [np.asarray(picture) for picture in pictures if not isinstance(picture, (DeblurResult, BurstResult))]
    kinds = {array.dtype.kind for array in arrays}
    if validate.is_auto(transfer) and {"u", "f"} <= kinds:
        raise InputError(
            "pictures has integers, which are sRGB, and floats, which are linear light unless they are the result of "
            'such integers: give results themselves instead of their images, or set transfer, such as "srgb"'
        )


def _checked_crop(crop: Any, height: int, width: int) -> tuple[int, int, int, int]:
    if not isinstance(crop, (tuple, list)) or len(crop) != 4:
        raise InputError(f"crop must be (top, left, height, width), got {validate.shown(crop)}")
    top = validate.count("top of crop", crop[0], minimum=0, maximum=height - 1)
    left = validate.count("left of crop", crop[1], minimum=0, maximum=width - 1)
    tall, wide = validate.count("height of crop", crop[2]), validate.count("width of crop", crop[3])
    return top, left, min(tall, height - top), min(wide, width - left)


def _display(picture: ArrayLike | DeblurResult | BurstResult, transfer: Transfer | Auto) -> FloatArray:
    """Return a picture as sRGB values in [0, 1], (H, W) or (H, W, 3), without alpha."""
    if isinstance(picture, (DeblurResult, BurstResult)):
        transfer, picture = picture.transfer, picture.image
    return displayed(picture, transfer)
