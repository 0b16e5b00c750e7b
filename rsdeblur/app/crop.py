"""Deblurring of a part of a picture, with the strengths and tiles that the whole picture gets."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.choices import Mode
from rsdeblur.image.encoded import ReadoutFrame, reduced
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult, plan
from rsdeblur.pipeline.solver import Strengths
from rsdeblur.psf import PsfBank


class Basis(NamedTuple):
    """Decisions of a whole picture for its crops: strengths, px of a tile and of the kernels when upright, and mode."""

    strengths: Strengths
    tile: tuple[float, float]
    psf: tuple[int, int]
    mode: Mode

    @property
    def strength(self) -> tuple[str, float]:
        """Name and value of the strength that a user sets: the prior's weight, or the Wiener filter's NSR."""
        weight = self.strengths.weight
        return ("nsr", self.strengths.nsr) if weight is None else ("weight", weight)


class Crop(NamedTuple):
    """A part of a picture, px."""

    left: int
    top: int
    width: int
    height: int

    def within(self, camera: Camera) -> Crop:
        """Return the crop, moved and reduced until it lies in the picture."""
        width, height = (max(1, min(n, most)) for n, most in ((self.width, camera.width), (self.height, camera.height)))
        left, top = max(0, min(self.left, camera.width - width)), max(0, min(self.top, camera.height - height))
        return Crop(left, top, width, height)

    def padded(self, margin: int, camera: Camera) -> Crop:
        """Return the crop with up to `margin` px on each side that the picture has."""
        left, top = max(0, self.left - margin), max(0, self.top - margin)
        right = min(self.left + self.width + margin, camera.width)
        return Crop(left, top, right - left, min(self.top + self.height + margin, camera.height) - top)

    def cut(self, pixels: NDArray[Any], scale: float = 1.0) -> NDArray[Any]:
        """Return the part of a picture that was reduced by `scale`."""
        rows, cols = (
            slice(round(scale * first), max(round(scale * (first + size)), round(scale * first) + 1))
            for first, size in ((self.top, self.height), (self.left, self.width))
        )
        return pixels[rows, cols]


def derive_basis(pixels: NDArray[Any], log: GyroLog, camera: Camera, exposure: Exposure, options: Options) -> Basis:
    """Return the strengths and tiles of a whole picture; they hold for its crops with another clock or lens, too."""
    prepared = plan(log, camera, exposure, options).prepare(pixels)
    assert prepared.strengths is not None
    assert prepared.bank is not None
    upright, bank = prepared.capture.camera, prepared.bank
    tile = upright.height / len(bank.rows), upright.width / len(bank.cols)
    return Basis(prepared.strengths, tile, bank.size, prepared.options.mode_in_effect)


def solve_crop(
    pixels: NDArray[Any],
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    options: Options,
    basis: Basis,
    crop: Crop,
    *,
    scale: float = 1.0,
) -> DeblurResult:
    """Deblur a crop of a whole picture with its surroundings, and return its part of the result.

    `pixels`, shape (H, W) or (H, W, C), and `camera` are those of the whole picture; strengths come from `basis`. At a
    `scale` below 1 the crop is solved at a smaller size: a half takes a quarter of the time or less. The places of the
    PSFs count from the crop's corner in px of the whole picture; the check covers the surroundings too.
    """
    options = replace(options, mode=basis.mode)
    # As far as the blur reaches, within bounds.
    outer = crop.padded(int(np.clip(max(basis.psf) // 2, 16, 64)), camera)
    part, lens = outer.cut(pixels), camera.cropped(*outer)
    if options.translation is not None:
        options = replace(options, translation=options.translation.cropped(camera, *outer))
    if scale < 1.0:
        part, lens = reduced(part, lens, max(16, round(scale * max(outer.width, outer.height))))
        scale = max(lens.width, lens.height) / max(outer.width, outer.height)
        # A Gaussian of the whole picture is narrower in px of the reduced one.
        options = replace(options, softness=scale * options.softness)
    if options.mode_in_effect == "banded":
        upright = ReadoutFrame(lens).camera
        # A tile is solved with several kernels of picture around it; in a draft, smaller ones cost more than they show.
        least = 2 if scale < 1.0 else 0
        bands, strips = (
            min(math.ceil(side / (scale * max(tile, least * psf))), side)
            for side, tile, psf in zip((upright.height, upright.width), basis.tile, basis.psf, strict=True)
        )
        options = replace(options, bands=bands, strips=strips)
    planned = plan(log, lens, exposure, options)
    result = replace(planned, strengths=basis.strengths).apply(part)
    inner = crop._replace(left=crop.left - outer.left, top=crop.top - outer.top)
    places = (result.psfs.rows / scale - inner.top, result.psfs.cols / scale - inner.left)
    return replace(
        result,
        image=inner.cut(result.image, scale),
        coverage=inner.cut(result.coverage, scale),
        psfs=PsfBank(result.psfs.kernels, *places),
    )
