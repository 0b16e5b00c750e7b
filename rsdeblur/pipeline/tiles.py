"""Number of bands and strips that a picture needs, and the PSFs of those tiles."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rsdeblur._util import validate
from rsdeblur.choices import Count, Mode
from rsdeblur.errors import InputError
from rsdeblur.motion.arguments import check_reach
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.pipeline.options import Options
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.tuning.strength import KERNELS

# Results are interpolated linearly between tiles. The number of tiles is such that paths interpolated linearly between
# them are this close to the true ones, px. Where the errors of any tiles are larger, rows are solved one by one.
TILE_PATH_ERROR = 0.1
# Interpolated results differ from the result of interpolated paths: at the highest frequency that the filter restores,
# about 1 / (pi L sqrt(nsr)) for a path of L px and never more than 1/2, neighbouring tiles must still agree in phase.
# Their paths may differ by this many L sqrt(nsr). (Both numbers: docs/developer/decisions.md.)
TILE_CHANGE = 0.4
# Noise-to-signal ratio that decides the automatic numbers of tiles where none is derived from the picture: for PSFs
# without a picture, and for those with which the light behind clipped pixels is estimated.
NSR = 0.01
# Bounds of the cost for violent motion.
MOST_BANDS = 64
MOST_STRIPS = 16
# Bound of numbers that are given: a PSF takes memory and time in every mode, whatever the size of its tile.
MOST_TILES = 16_384

# The motion that blurs a picture, or its PSFs.
Blur = Capture | PsfBank


def tile_paths(capture: Capture, mode: Mode, bands: Count, strips: Count, nsr: float) -> BlurPaths:
    """Return the paths at the centres of the tiles.

    `nsr` decides the numbers of bands and strips that are "auto". An `InputError` says that the blur is larger than the
    picture, or that there are more tiles than the picture can have.
    """
    check_reach(capture)
    height, width = capture.camera.height, capture.camera.width
    if mode == "banded":
        validate.count("bands", 1 if bands == "auto" else bands, maximum=height)
    if mode != "global":
        validate.count("strips", 1 if strips == "auto" else strips, maximum=min(width, 256))
    automatic = _automatic_counts(capture, nsr)
    if mode == "global":
        counts = 1, 1
    elif mode == "rowwise":
        # The PSFs of so many rows are reported.
        counts = min(9, height), automatic[1] if strips == "auto" else strips
    else:
        counts = automatic[0] if bands == "auto" else bands, automatic[1] if strips == "auto" else strips
    if counts[0] * counts[1] > MOST_TILES:
        raise InputError(f"bands times strips must be at most {MOST_TILES}, got {counts[0]} x {counts[1]}")
    rows, cols = (tile_centres(n, length) for n, length in zip(counts, (height, width), strict=True))
    paths = BlurPaths.from_capture(capture, rows, cols)
    tall, wide = (2 * int(reach) + 3 for reach in paths.extent)
    validate.memory(
        f"{counts[0]} x {counts[1]} PSFs of {wide}x{tall} px", 8 * counts[0] * counts[1] * tall * wide, height * width
    )
    return paths


def few_psfs(blur: Blur, *, threads: int | None) -> PsfBank:
    """Return a few PSFs that are spread over the picture, for automatic strengths; all PSFs that are given."""
    return psfs_of(blur, KERNELS, KERNELS, threads=threads)


def psfs_of(blur: Blur, bands: Count = "auto", strips: Count = "auto", *, threads: int | None) -> PsfBank:
    """Return the PSFs of tiles, as many as there are rows and columns at most; all PSFs that are given."""
    if isinstance(blur, PsfBank):
        return blur
    bands = bands if bands == "auto" else min(bands, blur.camera.height)
    strips = strips if strips == "auto" else min(strips, blur.camera.width)
    return PsfBank.from_paths(tile_paths(blur, "banded", bands, strips, NSR), threads=threads)


def tile_errors(capture: Capture) -> tuple[float, float]:
    """Return the mean squares of the path errors that tiles make down and across the picture, px^2.

    A tile undoes one blur, but the pixels over which a point was spread have other paths than that point: as much as
    paths change over the radius of the blur.
    """
    probe = capture.probe
    paths, places = probe.displacements, (probe.rows, probe.cols)

    def error(axis: int) -> float:
        at = places[axis]
        if len(at) == 1:
            return 0.0
        change = np.square(np.diff(paths, axis=axis)).sum(axis=-1).mean() / (at[1] - at[0]) ** 2
        return float(change * np.square(paths[..., 1 - axis]).mean())

    return error(0), error(1)


def with_mode(options: Options, captures: Iterable[Capture]) -> Options:
    """Return the options with the mode that the motion of one or several pictures chooses, if they leave it open.

    It is "rowwise" where tiles err down the picture by more than `TILE_PATH_ERROR`.
    """
    if not options.mode_is_open:
        return options
    error = max(tile_errors(capture)[0] for capture in captures)
    return replace(options, mode="rowwise" if error > TILE_PATH_ERROR**2 else "banded")


def _automatic_counts(capture: Capture, nsr: float) -> tuple[int, int]:
    """Return the numbers of bands and strips that limit the change of the blur between neighbouring tiles."""
    probe, camera = capture.probe, capture.camera
    allowed = TILE_CHANGE * max(float(probe.lengths.max()) * np.sqrt(nsr), 2 / np.pi)
    measured = [(largest_derivative(probe, 2, axis), largest_derivative(probe, 1, axis)) for axis in (0, 1)]
    needed = [max(np.sqrt(curvature / (8 * TILE_PATH_ERROR)), change / allowed) for curvature, change in measured]
    counts = []
    for tiles, reach, length, most in zip(
        needed, probe.extent, (camera.height, camera.width), (MOST_BANDS, MOST_STRIPS), strict=True
    ):
        # A PSF spans 2 reach + 1 px. Most rows that a tile narrower than half of that filters belong to other tiles.
        bound = min(most, max(1, int(length / (reach + 0.5))))
        counts.append(int(np.clip(np.ceil(tiles), 1, bound)))
    return counts[0], counts[1]


def largest_derivative(paths: BlurPaths, order: int, axis: int) -> float:
    """Return the largest change (order 1) or curvature (2) of paths along an axis, px per (squared) length of the grid.

    It is that of points at equal shares of the exposure. Paths that are interpolated linearly between N equal parts of
    the picture err by about the curvature over 8 N^2.
    """
    differences = np.linalg.norm(np.diff(paths.displacements, n=order, axis=axis), axis=-1)
    return float(differences.max(initial=0.0)) * float(paths.displacements.shape[axis] - 1) ** order
