"""Deconvolution with the caller's own PSFs: everything that :func:`rsdeblur.deblur` offers, without a motion."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.choices import Mode, Transfer
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.estimate.posterior import LEAST_TILES, MOST_NATS, softness, tile_places
from rsdeblur.image.encoded import EncodedImage, result_like
from rsdeblur.image.highlights import full_scale
from rsdeblur.image.transfer import from_linear, to_linear
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult, result_of
from rsdeblur.pipeline.solver import PictureSolver
from rsdeblur.pipeline.steps import StageClock, derive_strengths, solve_chunks, split_highlights
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.noise import TILE, TilePeriodograms
from rsdeblur.types import Progress

# Options that describe a motion, or how its picture is solved.
OF_MOTIONS = (
    *("mode", "bands", "strips", "chroma", "geometry", "motion"),
    *("translation", "softness", "refine", "fallback"),
)
# Side of the middle part of a picture that is solved for the check, px; how many sizes of the PSF it must have; and how
# many times more must be left over to be clear: what is right leaves at most 1.2 times what is wrong. Less than half a
# step of 8 bits says nothing.
CHECKED, SIZES, CLEARLY, LEAST = 320, 6, 1.5, 0.5 / 255
# Factors on the size of PSFs that are compared, side of the part of the picture in tiles, length of the PSFs there, px,
# and the least lead of another size that is remarked, nats per tile (`python -m benchmarks.kernels`).
FACTORS, TILES, LONGEST, LEAST_LEAD = (0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.35, 1.5), 6, 40, 2.0
# Share of a PSF that its floor may have: a Gaussian that is cut off at 2.7 standard deviations has 0.07.
FLOOR = 0.1


def deconvolve(
    image: ArrayLike,
    psf: ArrayLike | PsfBank,
    *,
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> DeblurResult:
    """Remove a known blur from a picture.

    One PSF is undone in the whole picture, several in tiles whose results are blended. Strengths are derived from the
    picture and the PSFs, as :func:`rsdeblur.deblur` does.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        See :func:`rsdeblur.deblur`.
    psf : array_like, shape (kh, kw) or (B, S, kh, kw), or PsfBank
        The PSF, or PSFs that are exact at the centres of B x S equal tiles, or PSFs at given places. Sizes are odd, and
        each PSF sums to 1; see :class:`rsdeblur.PsfBank` for the orientation.
    out, progress
        See :func:`rsdeblur.deblur`.
    **options
        `quality`, `prior`, `weight`, `exponent`, `nsr`, `noise`, `border`, `transfer`, `normalize`, `saturation`,
        `check`, `threads` and `max_memory` of :class:`rsdeblur.Options`. A border of "auto" is "unknown",
        but "blend" with ``prior="wiener"`` or `max_memory`. With "periodic", the automatic strengths take it that the
        picture was blurred so.

    Returns
    -------
    DeblurResult
        The sharp picture, and what was used for it, without a verdict.

    Raises
    ------
    InputError
        If an argument is out of range, the PSF is larger than the picture, or its place lies outside.

    Warns
    -----
    RsdeblurWarning
        With `check`, if a PSF is not 0 along its rim, or another encoding or the PSFs turned by half a turn explain the
        picture clearly better: where they are right, a result blurred again is the picture. Three results of the
        middle 320 px of it tell. And if larger or smaller PSFs explain its spectra clearly better, see
        :meth:`rsdeblur.PsfBank.scaled`.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> image, kernel = np.full((64, 64), 0.5), np.full((1, 5), 0.2)
    >>> rsdeblur.deconvolve(image, kernel, prior="hyper-laplacian", noise=0.01).image.shape
    (64, 64)
    """
    for name in OF_MOTIONS:
        if name in options:
            raise InputError(f"deconvolve takes no {name}: it has no motion", argument=name)
    return deconvolve_with(Options(mode="banded", **options), image, psf, out=out, progress=progress)


def deconvolve_with(
    options: Options,
    image: ArrayLike,
    psf: ArrayLike | PsfBank,
    *,
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
) -> DeblurResult:
    """Run :func:`deconvolve` with its keywords in `options`; the options that describe a motion are ignored."""
    clock = StageClock(validate.callback("progress", progress))
    options = replace(options, mode="banded")
    if options.border == "auto":
        solved = options.prior_in_effect != "wiener" and options.max_memory is None
        options = replace(options, border="unknown" if solved else "blend")
    encoded = EncodedImage.of(image, options.transfer)
    try:
        bank = psf if isinstance(psf, PsfBank) else PsfBank.for_picture(psf, encoded.shape)
    except InputError as error:
        raise InputError(f"psf: {error}") from error
    check_bank(bank, encoded.shape)
    if options.check:
        for remark in remarks_on(encoded, bank, options):
            warnings.warn(remark, RsdeblurWarning, stacklevel=3)
    return _solved(image, encoded, bank, options, out, clock)


def _solved(
    image: ArrayLike,
    encoded: EncodedImage,
    bank: PsfBank,
    options: Options,
    out: NDArray[Any] | None,
    clock: StageClock,
) -> DeblurResult:
    """Remove the blur of PSFs, of which the outermost may lie outside the picture."""
    if bank.displacements is None:
        # Kernels, unlike paths, have no half size.
        options = replace(options, chroma="full")
    out, channelled = result_like(image, out)
    (split,) = split_highlights([encoded], options, [bank], clock)
    with clock.stage("tune"):
        strengths = derive_strengths(split, options, bank)
    solver = PictureSolver(options, strengths, bank)
    coverage = solve_chunks(split, channelled, solver, clock)
    found = {"coverage": coverage, "timings": clock.timings, "mode": mode_of(bank), "blurred": np.asarray(image)}
    return result_of(out, encoded, solver, bands=bank.kernels.shape[0], **found)


def remarks_on(encoded: EncodedImage, bank: PsfBank, options: Options) -> list[str]:
    """Return what a picture says against its encoding and its PSFs; pictures that are small beside PSFs say nothing."""
    height, width, channels = encoded.shape
    rows, cols = (slice((n - min(n, CHECKED)) // 2, (n + min(n, CHECKED)) // 2) for n in (height, width))
    if (floor := _floor(bank.kernels)) > FLOOR:
        return [
            f"the PSF is not 0 along its rim; a floor of that value makes {floor:.0%} of it: subtract it, or is the "
            "picture of the PSF inverted?"
        ]
    factor, lead = likeliest_size(encoded, bank)
    if lead > LEAST_LEAD:  # other sizes pass for another encoding below
        return [f"the PSF fits the picture better {factor:g} times as large: try PsfBank.scaled or --psf-scale"]
    if SIZES * max(bank.size) > min(rows.stop - rows.start, cols.stop - cols.start):
        return []
    part = replace(bank.cut(rows, cols), displacements=None, softness=0.0)
    turned = replace(part, kernels=part.kernels[..., ::-1, ::-1])
    # One channel says as much as all.
    stored = encoded.values[rows, cols, channels // 2].astype(np.float32) / np.float32(full_scale(encoded.values))
    options = replace(options, quality="balanced", prior=None, weight="auto", nsr="auto", noise="auto")
    options = replace(options, border="unknown", max_memory=None, transfer=encoded.transfer)
    other: Transfer = "srgb" if encoded.transfer == "linear" else "linear"
    own, remarks = _left(stored, part, options), list[str]()
    if own < LEAST:
        return remarks
    if own > CLEARLY * _left(stored, part, replace(options, transfer=other)):
        remarks.append(
            f"the PSF fits the picture better with transfer {other}; published kernels often belong to stored values"
        )
    if own > CLEARLY * _left(stored, turned, options):
        remarks.append("the PSF fits the picture better turned by half a turn; try that")
    return remarks


def likeliest_size(encoded: EncodedImage, bank: PsfBank) -> tuple[float, float]:
    """Return the factor on the size of PSFs with which the spectra of a picture are likeliest, and by how much.

    That is in nats per tile of the picture's middle, reduced at least by half: cameras denoise and sharpen fine detail.
    """
    step = max(2, -(-max(bank.size) // LONGEST))
    sizes = [min(n // step, TILES * TILE) for n in encoded.shape[:2]]
    if min(sizes) < TILE:
        return 1.0, 0.0
    rows, cols = (
        slice(start := (n - size * step) // 2, start + size * step)
        for n, size in zip(encoded.shape[:2], sizes, strict=True)
    )
    middle = EncodedImage(encoded.values[rows, cols, : encoded.shape[2]], encoded.transfer).grey(slice(None))
    light = middle.reshape(sizes[0], step, sizes[1], step).mean(axis=(1, 3))
    tops, lefts = map(tile_places, light.shape)
    measured = TilePeriodograms(light, tops, lefts, softness=softness(1 / step), white=False)
    part = bank.cut(rows, cols)
    down, across = (
        np.abs((first[:, None] + (TILE - 1) / 2) * step - centres).argmin(axis=1)
        for first, centres in ((tops, part.rows), (lefts, part.cols))
    )
    place = (down[:, None] * len(part.cols) + across).ravel()
    nats = [measured.fit(measured.expected(part.scaled(factor / step).kernels), place)[0] for factor in (1.0, *FACTORS)]
    leads = MOST_NATS * np.tanh((nats[0] - np.array(nats[1:])) / MOST_NATS).sum(axis=1) / max(len(place), LEAST_TILES)
    return FACTORS[int(leads.argmax())], float(leads.max())


def _floor(kernels: NDArray[np.float32]) -> float:
    """Return the share of PSFs (B, S, kh, kw) that a floor as high as their rim would be; 0 for lines and boxes."""
    tall, wide = kernels.shape[2:]
    rim = np.ones((tall, wide), dtype=np.bool_)
    rim[1:-1, 1:-1] = False
    shares = np.median(kernels[..., rim], axis=-1) * tall * wide
    is_box = kernels.min(axis=(2, 3)) > 0.9 * kernels.max(axis=(2, 3))
    return 0.0 if rim.all() else float(np.where(is_box, 0.0, shares).max())


def _left(stored: NDArray[np.float32], bank: PsfBank, options: Options) -> float:
    """Return what a result blurred again leaves over of stored values, root mean square.

    Light below black, which only wrong PSFs and encodings need, has been removed from the result.
    """
    encoded = EncodedImage.of(stored, options.transfer)
    sharp, transfer = _solved(stored, encoded, bank, options, None, StageClock()).image, encoded.transfer
    blurred = TileBlur(bank, sharp.shape, threads=options.threads).forward(to_linear(sharp, transfer))
    tall, wide = bank.size
    inner = np.s_[tall:-tall, wide:-wide]
    again = from_linear(blurred[inner].clip(0, None), transfer)
    return float(np.sqrt(np.square(again - stored[inner])[stored[inner] < 1].mean()))


def mode_of(bank: PsfBank) -> Mode:
    """Return the mode in which PSFs are undone."""
    return "global" if bank.kernels.shape[:2] == (1, 1) else "banded"


def check_bank(bank: PsfBank, shape: tuple[int, ...]) -> None:
    """Raise `InputError` unless the PSFs fit a picture of `shape`."""
    (tall, wide), (height, width) = bank.size, shape[:2]
    if tall > height or wide > width:
        raise InputError(f"the PSF of {wide}x{tall} px is larger than the picture of {width}x{height} px")
    for name, places, length in (("rows", bank.rows, height), ("cols", bank.cols, width)):
        if places[0] < 0 or places[-1] > length - 1 or (np.diff(places) < 1).any():
            raise InputError(
                f"{name} of the PSFs must lie within the picture of {width}x{height} px, a pixel or more apart, got "
                f"{len(places)} from {places[0]:g} to {places[-1]:g} px; PSFs fit pictures of the size that "
                "they were made for"
            )
