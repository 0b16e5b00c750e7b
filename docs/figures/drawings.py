"""Drawings of axes, turns, readout and windows, computed with the package: `python docs/figures/drawings.py`.

Writes SVG files beside itself. Signs come out of `imu_to_camera`, `Camera` and `Exposure`, so a drawing cannot
contradict the code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from rsdeblur import Camera, Exposure, GyroLog, PsfBank
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.gyro import rotation_matrix
from rsdeblur.simulation.shake import hand_shake

HERE = Path(__file__).parent
PICTURE, DEVICE, READOUT, GREY = "#0b7285", "#c2410c", "#6d28d9", "#6b7280"
STYLE = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "rsdeblur",  # the same drawing gives the same file
    "font.family": "sans-serif",
    "font.size": 10,
    "savefig.facecolor": "white",
}
ARROW = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 14, "linewidth": 1.6}


def arrow(ax: Axes, start: np.ndarray, step: np.ndarray, colour: str, text: str = "") -> None:
    """Draw an arrow, with text at its tip."""
    ax.annotate("", start + step, start, arrowprops={**ARROW, "color": colour})
    if text:
        ax.annotate(text, start + 1.16 * step, color=colour, ha="center", va="center", weight="bold")


def picture_axes(ax: Axes, width: float, height: float) -> None:
    """Give `ax` picture coordinates: x right, y down, the same scale."""
    ax.set(xlim=(-width, width), ylim=(height, -height), aspect="equal")
    ax.axis("off")


def phones() -> Figure:
    """How a phone is held for each preset, seen by who holds it, with the stored picture upright."""
    sensor = Camera(4000, 3000, 3000.0, readout_time=0.02, imu_to_camera="phone-landscape")
    cameras = [sensor]
    for _ in range(3):
        cameras.append(cameras[-1].turned())
    names = ("phone-landscape", "phone-portrait", "phone-landscape-reversed", "phone-portrait-reversed")
    figure, panels = plt.subplots(1, 4, figsize=(11.5, 3.9))
    for ax, name, camera in zip(panels, names, cameras, strict=True):
        assert np.array_equal(camera.imu_to_camera, imu_to_camera(name))
        _phone(ax, name, camera)
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.99, wspace=0.04)
    return figure


def _phone(ax: Axes, name: str, camera: Camera) -> None:
    x, y = camera.imu_to_camera[:2, 0], camera.imu_to_camera[:2, 1]  # the device's axes in the picture's plane
    picture_axes(ax, 1.6, 1.75)
    corners = np.array([(-0.62, -1.25), (0.62, -1.25), (0.62, 1.25), (-0.62, 1.25)])
    ax.add_patch(Polygon([a * x + b * y for a, b in corners], facecolor="#f1f5f9", edgecolor=GREY, lw=5))
    ax.plot(*np.array([-0.15 * x + 1.13 * y, 0.15 * x + 1.13 * y]).T, color=GREY, lw=3, solid_capstyle="round")
    half = np.array([0.74, 0.5]) if camera.width > camera.height else np.array([0.46, 0.66])
    ax.add_patch(Rectangle(-half, *(2 * half), facecolor="#cffafe", edgecolor=PICTURE, lw=1.5))
    arrow(ax, -half, np.array([2 * half[0] + 0.3, 0]), PICTURE, "x")
    arrow(ax, -half, np.array([0, 2 * half[1] + 0.3]), PICTURE, "y")
    _house(ax)
    origin = -0.62 * x - 1.25 * y
    for step, off, text in ((x, y, "x"), (y, x, "y")):
        arrow(ax, origin, 0.55 * step, DEVICE)
        ax.annotate(text, origin + 0.4 * step - 0.16 * off, color=DEVICE, ha="center", va="center", weight="bold")
    _readout_arrow(ax, camera.readout_direction, half)
    ax.text(0, -1.7, f'"{name}"', ha="center", va="top", family="monospace")
    ax.text(0, 1.7, f"usual readout: {camera.readout_direction}", ha="center", va="bottom", color=READOUT)


def _house(ax: Axes) -> None:
    ax.add_patch(Polygon([(-0.2, 0.0), (0, -0.2), (0.2, 0.0)], facecolor=PICTURE, lw=0, alpha=0.6))
    ax.add_patch(Rectangle((-0.15, 0.0), 0.3, 0.22, facecolor=PICTURE, lw=0, alpha=0.6))


def _readout_arrow(ax: Axes, direction: str, half: np.ndarray) -> None:
    step = {"top-down": (0, 1), "bottom-up": (0, -1), "left-right": (1, 0), "right-left": (-1, 0)}[direction]
    along = np.array(step) * 0.8 * half
    side = np.array([0.8 * half[0], 0.0]) if step[0] == 0 else np.array([0.0, 0.8 * half[1]])
    arrow(ax, side - along, 2 * along, READOUT)


def turns() -> Figure:
    """How points move over the picture while the camera turns about each of its axes."""
    camera = Camera(401, 301, 330.0)
    x, y = np.meshgrid(np.linspace(30, 370, 7), np.linspace(30, 270, 5))
    points = np.stack([x, y], axis=-1)
    said = ("tilt up:  wx > 0", "pan right:  wy > 0", "roll clockwise, from behind:  wz > 0")
    figure, panels = plt.subplots(1, 3, figsize=(11.5, 3.2))
    for axis, (ax, text) in enumerate(zip(panels, said, strict=True)):
        angle = np.zeros(3)
        angle[axis] = np.deg2rad((4.0, 4.0, 9.0)[axis])
        # C(t + dt) = exp(-[omega dt]x) C(t) takes directions from the old camera to the turned one.
        moved = camera.project(camera.rays(points) @ rotation_matrix(-angle).T)
        ax.add_patch(Rectangle((0, 0), 400, 300, facecolor="#f8fafc", edgecolor=GREY))
        ax.plot(*points.reshape(-1, 2).T, "o", color=GREY, ms=3)
        for start, end in zip(points.reshape(-1, 2), moved.reshape(-1, 2), strict=True):
            if np.hypot(*(end - start)) > 2:
                arrow(ax, start, end - start, PICTURE)
        ax.set(xlim=(-20, 420), ylim=(320, -20), aspect="equal", title=text)
        ax.axis("off")
    figure.subplots_adjust(0.01, 0.01, 0.99, 0.9, wspace=0.03)
    return figure


def readout_time() -> Figure:
    """When each line is exposed, for the four readout directions."""
    directions = ("top-down", "bottom-up", "left-right", "right-left")
    figure, panels = plt.subplots(2, 4, figsize=(11.5, 5.2), height_ratios=(1, 1.6))
    for (above, below), direction in zip(panels.T, directions, strict=True):
        half = np.array([1.0, 0.7])
        picture_axes(above, 1.2, 0.85)
        above.add_patch(Rectangle(-half, *(2 * half), facecolor="#cffafe", edgecolor=PICTURE, lw=1.5))
        _readout_arrow(above, direction, half)
        above.set_title(f'"{direction}"', family="monospace", fontsize=10)
        _windows(below, direction)
    figure.tight_layout()
    return figure


def _windows(ax: Axes, direction: str) -> None:
    camera = Camera(12, 12, 10.0, readout_time=0.03, readout_direction=direction)
    exposure = Exposure(0.0, 0.02)
    lines = np.arange(12)
    opens, closes = exposure.window(lines, camera)
    ax.barh(lines, 1e3 * (closes - opens), left=1e3 * opens, height=0.75, color="#a5d8e6", edgecolor=PICTURE, lw=0.6)
    mid = 1e3 * (opens + closes) / 2
    ax.plot(mid, lines, ".", color=PICTURE, ms=3)
    for timestamp, line in (("start", np.argmin(opens)), ("middle", 5.5), ("end", np.argmax(opens))):
        # A capture stamped 0 opens before 0 by what its timestamp marks.
        moment = -1e3 * exposure.window(lines, replace(camera, timestamp_marks=timestamp))[0].min()
        ax.plot(moment, line, "D", color=DEVICE, ms=5)
        place = {"start": (-4, 6), "middle": (32, 0), "end": (8, 6)}[timestamp]
        ax.annotate(
            timestamp,
            (moment, line),
            place,
            textcoords="offset points",
            color=DEVICE,
            ha="center",
            va="center",
            weight="bold",
        )
    ax.set(ylim=(11.9, -1.6), xlim=(-6, 57), xlabel="time, ms", yticks=[0, 11], xticks=[0, 30, 50])
    ax.set_ylabel("row" if direction in ("top-down", "bottom-up") else "column", labelpad=-6)
    ax.spines[["top", "right"]].set_visible(False)


def windows() -> Figure:
    """Three rows' windows in a gyro log, and the kernels that follow."""
    log = hand_shake(0.3, strength=0.9, seed=4)
    camera, exposure = Camera(400, 300, 420.0, readout_time=0.03), Exposure(0.1, 0.04)
    rows = np.array([20.0, 150.0, 280.0])
    colours = (PICTURE, READOUT, DEVICE)
    figure, (left, *right) = plt.subplots(1, 4, figsize=(11.5, 2.9), width_ratios=(3, 1, 1, 1))
    for axis, (name, dash) in enumerate(zip("xyz", ("-", "--", ":"), strict=True)):
        left.plot(1e3 * log.t, log.omega[:, axis], dash, color="black", lw=1.2, label=f"$\\omega_{name}$")
    opens, closes = exposure.window(rows, camera)
    low, high = left.get_ylim()
    for i, (start, end, colour) in enumerate(zip(1e3 * opens, 1e3 * closes, colours, strict=True)):
        base = high + (0.14 * i + 0.08) * (high - low)
        left.axvspan(start, end, color=colour, alpha=0.1, lw=0)
        left.plot((start, end), (base, base), color=colour, lw=4, solid_capstyle="butt")
        left.text(end + 2, base, f"row {rows[i]:.0f}", color=colour, va="center")
    left.set(xlabel="time, ms", ylabel="rate, rad/s", xlim=(60, 210), ylim=(low, high + 0.5 * (high - low)))
    left.legend(loc="lower right", ncols=3, frameon=False)
    left.spines[["top", "right"]].set_visible(False)
    bank = PsfBank.from_paths(BlurPaths.from_capture(Capture.from_log(log, camera, exposure), rows, [200.0]))
    for ax, kernel, row, colour in zip(right, bank.kernels[:, 0], rows, colours, strict=True):
        ax.imshow(kernel, cmap="Greys", interpolation="nearest")
        ax.set(xticks=[], yticks=[])
        ax.set_title(f"kernel of row {row:.0f}", color=colour, fontsize=10)
        ax.spines[:].set_color(colour)
    figure.tight_layout()
    return figure


def operators() -> Figure:
    """Draw the blur of one row frequency as a matrix along y, as each mode takes it."""
    n, bands = 72, 4
    t = np.arange(-0.02, 0.14, 0.002)
    log = GyroLog(t, np.column_stack([2.2 * np.sin(55 * t + 0.6), 0 * t, 0 * t]))
    camera = Camera(n, n, 160.0, readout_time=0.05)
    capture = Capture.from_log(log, camera, Exposure(0.0, 0.05))
    tall = PsfBank.from_paths(BlurPaths.every_row(capture, [n / 2])).kernels[:, 0].sum(axis=2)
    centres = np.linspace(0, n - 1, bands)
    weights = np.array([np.interp(np.arange(n), centres, row) for row in np.eye(bands)]).T
    at_centres = tall[np.rint(centres).astype(int)]
    modes = {
        "global: one profile everywhere": np.repeat(tall[[n // 2]], n, axis=0),
        "banded: a few, blended": weights @ at_centres,
        "rowwise: each row's own": tall,
    }
    figure, panels = plt.subplots(1, 3, figsize=(11.5, 3.7))
    for ax, (title, profiles) in zip(panels, modes.items(), strict=True):
        reach = profiles.shape[1] // 2
        matrix = np.zeros((n, n + 2 * reach))
        for y in range(n):
            # h[s] weighs the latent row y - s
            matrix[y, y : y + 2 * reach + 1] = profiles[y, ::-1]
        ax.imshow(matrix, cmap="Greys", vmax=0.35, interpolation="nearest", extent=(-reach, n + reach, n, 0))
        ax.set_title(title, fontsize=10)
        ax.set(xlabel="row of the sharp picture", ylabel="recorded row")
        ax.axvspan(-reach, 0, color=PICTURE, alpha=0.12, lw=0)
        ax.axvspan(n, n + reach, color=PICTURE, alpha=0.12, lw=0)
    figure.tight_layout()
    return figure


DRAWINGS: tuple[Callable[[], Figure], ...] = (phones, turns, readout_time, windows, operators)


def main() -> None:
    """Write all drawings."""
    mpl.use("Agg")
    with mpl.rc_context(STYLE):
        for draw in DRAWINGS:
            figure = draw()
            figure.savefig(HERE / f"{draw.__name__}.svg", metadata={"Date": None})
            plt.close(figure)


if __name__ == "__main__":
    main()
