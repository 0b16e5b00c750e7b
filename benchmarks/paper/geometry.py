"""Figures 2a and 2b: shifts of the picture by translation and rotation, from geometry alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.paper.figure import Figure, lines

FIELD = np.radians(60.0)  # across the width
HALF_DIAGONAL = 2.3e-3  # m, of their sensor
SIZES = ((2048, 1536), (3264, 2448))
DISTANCES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)


def figures(quick: bool) -> Iterator[Figure]:
    """Yield figures 2a and 2b."""
    yield translation()
    yield rotation()


def focal_length(width: int) -> float:
    """Return the focal length in px for the field of view."""
    return float(width / 2 / np.tan(FIELD / 2))


def translation() -> Figure:
    """Return the figure of the shift by 1 mm of translation, over the distance of the scene."""
    curves = {f"{w}x{h}": [focal_length(w) * 1e-3 / d for d in DISTANCES] for w, h in SIZES}
    small, large = (curve[DISTANCES.index(2.0)] for curve in curves.values())
    return Figure(
        "fig2a",
        "Figure 2a: one millimetre of translation",
        "Shift in px when the camera moves by 1 mm sideways, over the distance of the scene; field of view 60 degrees.",
        f"Holds at their working size: at 2 m the shift is {small:.2f} px ({large:.2f} px at their sensor's full "
        "size), less beyond.",
        ("distance (m)", *curves),
        list(zip(DISTANCES, *curves.values(), strict=True)),
        lines(DISTANCES, curves, "distance (m)", "shift (px)", xscale="log", yscale="log"),
    )


def rotation() -> Figure:
    """Return the figure of the shift by 1 degree of rotation, over the distance from the centre."""
    width, height = SIZES[0]
    f, corner = focal_length(width), np.hypot(width, height) / 2
    radius = np.linspace(0.0, corner, 9)
    angle = np.radians(1.0)
    about_x = f * (np.tan(np.arctan(radius / f) + angle)) - radius
    about_z = 2 * radius * np.sin(angle / 2)
    millimetres = radius / corner * HALF_DIAGONAL * 1e3
    curves = {"about x": about_x.tolist(), "about z": about_z.tolist()}
    return Figure(
        "fig2b",
        "Figure 2b: one degree of rotation",
        f"Shift in px over the distance from the sensor's centre (half diagonal 2.3 mm, {width}x{height}), along the "
        "axis that the rotation about x moves.",
        f"Holds: about x the shift is large everywhere, {about_x[0]:.0f} px in the centre and {about_x[-1]:.0f} px in "
        f"the corner; about z it vanishes in the centre, but the {about_z[-1]:.0f} px in the corner are not small, and "
        "global mode neglects them.",
        ("distance (mm)", *curves),
        [tuple(map(float, row)) for row in zip(millimetres, about_x, about_z, strict=True)],
        lines(millimetres.tolist(), curves, "distance from the centre (mm)", "shift (px)", ylim=(0, None)),
    )
