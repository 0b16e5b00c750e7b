"""Deblurring of a part of a picture, with the strengths and tiles that the whole picture gets."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.image.encoded import reduced
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult, plan
from rsdeblur.pipeline.solver import Strengths
from rsdeblur.psf import PsfBank

# px around a crop that are solved with it and not shown: as far as the blur reaches, within these bounds.
LEAST_MARGIN, MOST_MARGIN = 16, 64
# Least side of a tile of a reduced crop, in kernels: a tile is solved with several kernels of picture around it, so
# smaller ones cost more than they show.
DRAFT_TILE = 2


@dataclass(frozen=True, slots=True)
class Basis:
    """Decisions that the whole picture makes for its crops.

    Parameters
    ----------
    strengths : Strengths
        Strengths of the solution.
    tile : (float, float)
        Height and width of a tile in px of the upright frame.
    psf : (int, int)
        Height and width of the kernels there, px.
    """

    strengths: Strengths
    tile: tuple[float, float]
    psf: tuple[int, int]

    @property
    def strength(self) -> tuple[str, float]:
        """Name and value of the strength that a user sets: the prior's weight, or the Wiener filter's NSR."""
        weight = self.strengths.weight
        return ("nsr", self.strengths.nsr) if weight is None else ("weight", weight)

    def with_strength(self, value: float) -> Basis:
        """Return the same with another value of that strength."""
        wiener = self.strengths.weight is None
        changed = replace(self.strengths, nsr=value) if wiener else replace(self.strengths, weight=value)
        return replace(self, strengths=changed)


@dataclass(frozen=True, slots=True)
class Crop:
    """A part of the picture, px."""

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
        right, bottom = (
            min(first + size + margin, most)
            for first, size, most in ((self.left, self.width, camera.width), (self.top, self.height, camera.height))
        )
        return Crop(left, top, right - left, bottom - top)

    def camera(self, camera: Camera) -> Camera:
        """Return the camera of the part."""
        return camera.cropped(self.left, self.top, self.width, self.height)

    def cut(self, pixels: NDArray[Any], scale: float = 1.0) -> NDArray[Any]:
        """Return the part of a picture that was reduced by `scale`."""
        (top, bottom), (left, right) = (
            (round(scale * first), max(round(scale * (first + size)), round(scale * first) + 1))
            for first, size in ((self.top, self.height), (self.left, self.width))
        )
        return pixels[top:bottom, left:right]


def derive_basis(pixels: NDArray[Any], log: GyroLog, camera: Camera, exposure: Exposure, options: Options) -> Basis:
    """Derive strengths and tiles from the whole picture.

    Parameters
    ----------
    pixels : ndarray, shape (H, W) or (H, W, C)
        The blurred picture.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    options : Options
        See :func:`rsdeblur.deblur`.

    Returns
    -------
    Basis
        For crops of this picture, also with another clock, readout or focal length.
    """
    prepared = plan(log, camera, exposure, options).prepare(pixels)
    assert prepared.strengths is not None
    assert prepared.bank is not None
    upright, bank = prepared.capture.camera, prepared.bank
    return Basis(prepared.strengths, (upright.height / len(bank.rows), upright.width / len(bank.cols)), bank.size)


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
    """Deblur a crop with its surroundings, and return its part of the result.

    Parameters
    ----------
    pixels : ndarray, shape (H, W) or (H, W, C)
        The whole blurred picture.
    log, camera, exposure
        The motion, the camera of the whole picture and the time of the exposure.
    options : Options
        See :func:`rsdeblur.deblur`; strengths come from `basis`.
    basis : Basis
        Strengths and tiles.
    crop : Crop
        The part, within the picture.
    scale : float, default 1.0
        Size at which the crop is solved, at most 1: a half takes a quarter of the time or less. Below 1, tiles have at
        least twice the size of the kernels.

    Returns
    -------
    DeblurResult
        Image and coverage of the crop. The places of its PSFs count from the crop's corner in px of the whole picture;
        the check covers the surroundings too.
    """
    outer = crop.padded(int(np.clip(max(basis.psf) // 2, LEAST_MARGIN, MOST_MARGIN)), camera)
    part, lens = outer.cut(pixels), outer.camera(camera)
    if options.translation is not None:
        moved = options.translation.cropped(camera, outer.left, outer.top, outer.width, outer.height)
        options = replace(options, translation=moved)
    if scale < 1.0:
        part, lens = reduced(part, lens, max(16, round(scale * max(outer.width, outer.height))))
        scale = max(lens.width, lens.height) / max(outer.width, outer.height)
        # A Gaussian of the whole picture is narrower in px of the reduced one.
        options = replace(options, softness=scale * options.softness)
    if options.mode_in_effect == "banded":
        upright = ReadoutFrame(lens).camera
        least = DRAFT_TILE if scale < 1.0 else 0
        bands, strips = (
            min(math.ceil(side / (scale * max(tile, least * psf))), side)
            for side, tile, psf in zip((upright.height, upright.width), basis.tile, basis.psf, strict=True)
        )
        options = replace(options, bands=bands, strips=strips)
    planned = plan(log, lens, exposure, options)
    result = replace(planned, strengths=basis.strengths).apply(part)
    inner = Crop(crop.left - outer.left, crop.top - outer.top, crop.width, crop.height)
    places = (result.psfs.rows / scale - inner.top, result.psfs.cols / scale - inner.left)
    return replace(
        result,
        image=inner.cut(result.image, scale),
        coverage=inner.cut(result.coverage, scale),
        psfs=PsfBank(result.psfs.kernels, *places),
    )
