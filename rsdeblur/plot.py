"""Plots with Matplotlib (extra ``[plot]``): paths, logs and comparisons; `rsdeblur.report.psf_map` draws kernels.

Every function draws into the axes that it is given, or into a new figure, and returns the axes. Matplotlib is imported
at the first call, so its backend can be chosen after this module is imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.burst.burst import BurstResult
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import displayed
from rsdeblur.motion.arguments import exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.report.drawings import DIM, MOST, fitting, thinned
from rsdeblur.report.facts import around, rates_in_camera
from rsdeblur.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["comparison", "log", "paths"]


def __dir__() -> list[str]:
    return __all__


def paths(paths: BlurPaths, picture: ArrayLike | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the paths of pixels at their places, enlarged by one factor, from dark (first) to bright (last).

    Parameters
    ----------
    paths : BlurPaths
        The paths; at most 12 x 9 of them are drawn.
    picture : array_like, shape (H, W) or (H, W, C), optional
        Picture below the paths, encoded as for :func:`rsdeblur.deblur` with ``transfer="auto"``.
    ax : matplotlib.axes.Axes, optional
        Where to draw; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Axes in px of the picture.

    Raises
    ------
    InputError
        If an argument is invalid, or Matplotlib is not installed.

    Examples
    --------
    >>> import rsdeblur.plot
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(640, 480, 500.0)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> grid = rsdeblur.motion.BlurPaths.from_capture(capture, rows=[100, 300], cols=[200, 400])
    >>> len(rsdeblur.plot.paths(grid).collections)
    4
    """
    validate.instance("paths", paths, BlurPaths)
    ax = _axes(ax)
    ax.set_facecolor("0.1")
    # Without a picture, its shape follows from even places.
    shape = tuple(round(places[0] + places[-1] + 1) for places in (paths.rows, paths.cols))
    if picture is not None:
        shape = np.shape(picture)
        ax.imshow(DIM * _display(picture, "auto"), cmap="gray", vmin=0.0, vmax=1.0, zorder=1)
    from matplotlib.collections import LineCollection

    down, across = map(thinned, paths.lengths.shape, MOST)
    rows, cols, drawn = paths.rows[down], paths.cols[across], paths.displacements[down, across]
    zoom = fitting(rows, cols, (2.0 * np.abs(drawn).max(axis=(0, 1, 2)) + 1.0)[::-1], shape)
    for path, (y, x) in zip(drawn.reshape(-1, *drawn.shape[2:]), product(rows, cols), strict=True):
        points = np.array([x, y]) + zoom * path
        pieces = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap="plasma", linewidth=2, zorder=2)
        pieces.set_array(np.linspace(0.0, 1.0, len(pieces.get_paths())))
        ax.add_collection(pieces)
    ax.set_aspect("equal")
    ax.set(xlim=(-0.5, shape[1] - 0.5), ylim=(shape[0] - 0.5, -0.5), xlabel="column, px", ylabel="row, px")
    ax.set_title(f"paths of up to {paths.lengths.max():.3g} px, drawn {zoom:.2g} times as large")
    return ax


def log(log: GyroLog, camera: Camera, exposures: Exposure | Iterable[Exposure] = (), *, ax: Axes | None = None) -> Axes:
    """Draw the rates of a gyro log in camera axes and camera time, with the windows of exposures.

    A window is dark while all rows are exposed, and lighter while some are.

    Parameters
    ----------
    log : GyroLog
        The log.
    camera : Camera
        Source of the axes, the time offset and the readout.
    exposures : Exposure or iterable of Exposure
        Exposures; with any, the plot shows the part of the log around them.
    ax : matplotlib.axes.Axes, optional
        Where to draw; default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Axes in s relative to the epoch of the first exposure, or of the log, and rad/s.

    Raises
    ------
    InputError
        If an argument is invalid, or Matplotlib is not installed.

    Examples
    --------
    >>> import rsdeblur.plot
    >>> shake, camera = rsdeblur.hand_shake(1.0, seed=1), rsdeblur.Camera(640, 480, 500.0, readout_time=0.03)
    >>> ax = rsdeblur.plot.log(shake, camera, rsdeblur.Exposure(0.4, 0.05))
    >>> ax.get_xlabel(), len(ax.lines)
    ('camera time, s', 3)
    """
    validate.instance("log", log, GyroLog)
    validate.instance("camera", camera, Camera)
    windows = exposure_list([exposures] if isinstance(exposures, Exposure) else exposures)
    ax = _axes(ax)
    epoch = windows[0].epoch_ns if windows else log.epoch_ns
    t, rates = rates_in_camera(log, camera, epoch)
    spans = [np.add(window.span(camera), (window.epoch_ns - epoch) * 1e-9) for window in windows]
    for window, (first, last) in zip(windows, spans, strict=True):
        ax.axvspan(first, last, color="0.9", linewidth=0)
        # While the last row opens until the first one closes, all rows are exposed.
        common = last - window.duration, first + window.duration
        if common[0] < common[1]:
            ax.axvspan(*common, color="0.75", linewidth=0)
    for rate, axis, colour in zip(rates.T, "xyz", ("tab:red", "tab:green", "tab:blue"), strict=True):
        ax.plot(t, rate, color=colour, linewidth=1, label=axis)
    if spans:
        ax.set_xlim(around(min(span[0] for span in spans), max(span[1] for span in spans)))
    ax.set(xlabel="camera time, s", ylabel="rate about the camera's axes, rad/s")
    ax.legend(loc="upper right", ncols=3)
    return ax


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
        If there is no picture, the shapes differ, `crop` shows nothing, or Matplotlib is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur.plot
    >>> grey = np.full((48, 64), 0.5)
    >>> axes = rsdeblur.plot.comparison({"grey": grey, "lighter": 1.1 * grey}, reference=grey)
    >>> [ax.get_title() for ax in axes]
    ['grey', 'lighter, 29.9 dB']
    """
    shown = {title: _display(picture, transfer) for title, picture in pictures.items()}
    truth = None if reference is None else _display(reference, transfer)
    shapes = {picture.shape for picture in shown.values()} | ({truth.shape} if truth is not None else set())
    if not shown or len(shapes) != 1:
        raise InputError(f"pictures must be at least one and all of one shape, got {sorted(shapes) or 'none'}")
    height, width = shapes.pop()[:2]
    top, left, tall, wide = (0, 0, height, width) if crop is None else crop
    tall, wide = min(tall, height - top), min(wide, width - left)
    if min(top, left) < 0 or min(tall, wide) < 1:
        raise InputError(f"crop shows nothing of a picture of {width}x{height} px: {crop}")
    plt = _pyplot()
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


def _pyplot() -> Any:
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise InputError(validate.missing("plots need Matplotlib", "plot")) from None
    return plt


def _axes(ax: Axes | None) -> Any:
    return _pyplot().subplots(layout="constrained")[1] if ax is None else ax


def _display(picture: ArrayLike | DeblurResult | BurstResult, transfer: Transfer | Auto) -> FloatArray:
    """Return a picture as sRGB values in [0, 1], (H, W) or (H, W, 3), without alpha."""
    if isinstance(picture, (DeblurResult, BurstResult)):
        transfer, picture = picture.transfer, picture.image
    return displayed(picture, transfer)
