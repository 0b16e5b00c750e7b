"""The functions of the package: photo, gyro log, camera and exposure in, sharp picture or PSFs out."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.choices import (
    EXPONENT,
    Auto,
    Border,
    Boundary,
    Chroma,
    Count,
    Geometry,
    Mode,
    Motion,
    Prior,
    Quality,
    Saturation,
    Strength,
    Transfer,
)
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult, plan, plan_for
from rsdeblur.pipeline.tiles import NSR as NSR
from rsdeblur.psf import PsfBank
from rsdeblur.types import Denoiser, Progress


def deblur(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    quality: Quality = "balanced",
    mode: Mode | Auto | None = None,
    bands: Count = "auto",
    strips: Count = "auto",
    prior: Prior | Denoiser | None = None,
    weight: Strength = "auto",
    exponent: float = EXPONENT,
    nsr: Strength = "auto",
    noise: Strength = "auto",
    chroma: Chroma | Auto = "auto",
    geometry: Geometry = "keep",
    border: Border | Boundary | Auto = "auto",
    motion: Motion = "rotation",
    translation: Translation | None = None,
    softness: float = 0.0,
    refine: bool = False,
    transfer: Transfer | Auto = "auto",
    normalize: bool = False,
    saturation: Saturation = "auto",
    check: bool = True,
    fallback: bool = False,
    threads: int | None = None,
    max_memory: int | None = None,
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
) -> DeblurResult:
    """Remove camera shake from a rolling-shutter picture.

    The keywords up to `max_memory` are the fields of :class:`rsdeblur.Options`. To deblur several pictures with the
    same settings, make a :func:`rsdeblur.plan` and apply it.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        Grey (without C, or C = 1), grey + alpha (2), RGB (3) or RGBA (4). uint8 and uint16 are scaled to [0, 1];
        floats have the nominal range [0, 1] and at most 1e12. Alpha is copied.
    log, camera, exposure
        The motion, the camera, and when the picture was exposed and for how long.
    quality : {"balanced", "fast", "best"}
        Mode and prior, where they are not given: "auto" with "hyper-laplacian", "banded" with "wiener", which is
        the published filter in tiles, with less noise because of its `chroma`, or "rowwise" with "hyper-laplacian".
    mode : {"auto", "banded", "global", "rowwise"}, optional
        One PSF per tile; one for the whole picture (Sindelar and Sroubek 2013); or one per row, solved exactly. "auto"
        is "rowwise" where the blur changes so much within its own height that tiles err by more than 0.1 px
        (:attr:`DeblurResult.tile_error`), and "banded" elsewhere, with a number of `bands`, and with
        ``border="unknown"``. By default that of `quality`.
    bands, strips : int or "auto"
        Number of tiles along the readout axis and across it; "auto" limits the change of the blur between neighbouring
        tiles. "global" ignores both, "rowwise" ignores `bands`.
    prior : str or callable, optional
        Regularisation, by default that of `quality`; `rsdeblur.choices.PRIORS` lists all names. "wiener" is the Wiener
        filter; "gradient", "tv" and "hyper-laplacian" are penalties on derivatives (:mod:`rsdeblur.deconv.priors`);
        "cnn" is a small network (:mod:`rsdeblur.deconv.cnn`). Any other denoiser is called as ``denoise(image, sigma)``
        (:mod:`rsdeblur.deconv.plug_and_play`). "tv" and "hyper-laplacian" keep edges sharp and even areas free of
        noise; "wiener" takes about a fifth of their time. All but the linear ones, "wiener" and "gradient", fade
        towards the input where light would be below black (:mod:`rsdeblur.image.mending`), and keep to its colours
        beside clipped light (:mod:`rsdeblur.image.mending`).
    weight : float or "auto"
        Weight of the prior, from 1e-20 to 1e20: a larger weight gives a smoother picture. "auto" derives it from the
        picture's noise and the blur (:mod:`rsdeblur.tuning.strength`).
    exponent : float, default 2/3
        Exponent of the hyper-Laplacian, in (0, 1].
    nsr : float or "auto"
        Noise-to-signal power ratio Phi, from 1e-20 to 1e20: a larger ratio gives a smoother picture. For the Wiener
        filter, "auto" derives it from noise and blur. The other priors depend on it little; "auto" then derives it from
        the size of the blur.
    noise : float or "auto"
        Standard deviation of the picture's noise in linear light, in which white is 1, from 0 to 1e12; "auto" estimates
        it. The automatic strengths are derived from it.
    chroma : {"auto", "full", "half"}
        Resolution of the colours. "half" restores the brightness at full resolution and the colours at half of it, as
        JPEG and video store them (:mod:`rsdeblur.deconv.chroma`): priors on derivatives take three quarters to four
        fifths of the time. It goes with these and with "wiener", but not with ``border="unknown"``, and applies to RGB
        pictures with a blur of some pixels. "auto" is "half" with "tv", "hyper-laplacian" and
        ``quality="fast"``; "full" keeps results of "wiener" and "gradient" linear in the picture.
    geometry : {"keep", "rectify"}
        Keep the rolling-shutter shape, or resample the picture to the middle row's mid-exposure.
    border : {"auto", "blend", "periodic", "unknown"}
        How the picture continues beyond its frame; "auto" is "blend". See :class:`rsdeblur.Deconvolver` for "blend" and
        "periodic". "unknown" solves for what the camera would have recorded there (Reeves 2005; Almeida and Figueiredo
        2013): it takes two to four times as long, and every prior but "wiener". "rowwise" takes the first three only.
    motion : {"rotation", "small-angle"}
        Paths of the full homography, or the approximation of eq. 6 of Sindelar and Sroubek (2013).
    translation : Translation, optional
        Positions of the camera and distance of the scene (eq. 3 in full); without it only rotation counts.
    softness : float, default 0.0
        Standard deviation in px, from 0 to 1, of the Gaussian by which lens, pixels and demosaicing blur the picture;
        it is undone together with the motion.
    refine : bool, default False
        Correct focal length, clock, readout and motion by the picture first, see :func:`rsdeblur.refine`.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light; a number is a gamma, from 0.1 to 10. "auto" is sRGB for uint8 and uint16 and linear for
        floats: set it for photos whose integers you divided. The result has the same encoding.
    normalize : bool, default False
        Compress light that exceeds [0, 1] into that range and clip outliers, at the price of contrast.
    saturation : {"auto", "ignore", "always"}
        "always" estimates the highlights behind clipped pixels, solves the picture without them and adds them to the
        result (:mod:`rsdeblur.image.highlights`). This leaves fewer streaks around lamps and takes 19 passes of a
        filter over boxes around them. It does not change the result of a picture without clipped highlights. "auto"
        does so where small clipped spots cover at most 0.5 % of the picture, or half of the picture has less than 5 %
        of full light. By day, more of them are rather white things in the sun, which would lose detail: then it takes
        the smallest, up to 0.1 %. With ``quality="fast"`` and `max_memory`, "auto" is "ignore".
    check : bool, default True
        Assess the result without a reference.
    fallback : bool, default False
        Return the input if the check finds the result bad; not with ``geometry="rectify"``.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.
    max_memory : int, optional
        Bytes that the work may use in addition to the picture and its result: large pictures are solved in chunks of
        rows. The picture and `out` may be memory-mapped files.
    out : ndarray, float32, uint8 or uint16, shaped like `image`, optional
        Receives the result; integers are clipped and rounded.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    DeblurResult
        The sharp picture, and what was used for it.

    Raises
    ------
    InputError
        If an argument is out of range, the picture's size is not the camera's, the blur is larger than the picture, or
        the result is not finite.
    CoverageError, ClockError, GapError
        If the log does not cover the exposure, is on another clock, or has a gap inside the exposure.

    Warns
    -----
    RsdeblurWarning
        If `transfer` is "auto" and floats are multiples of 1/255 or whole numbers beyond 1, as encoded values are.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(96, 72, 100.0, readout_time=0.03)
    >>> exposure = rsdeblur.Exposure(0.2, 0.05)
    >>> blurred, _, _ = rsdeblur.simulate(rsdeblur.scene(96, 120), log, camera, exposure, noise=0.005)
    >>> result = rsdeblur.deblur(blurred, log, camera, exposure)
    >>> result.image.shape, result.check.verdict
    ((72, 96, 3), 'good')
    """
    options = Options(
        quality=quality, mode=mode, bands=bands, strips=strips, prior=prior, weight=weight, exponent=exponent, nsr=nsr,
        noise=noise, chroma=chroma, geometry=geometry, border=border, motion=motion,
        translation=translation, softness=softness, refine=refine, transfer=transfer, normalize=normalize,
        saturation=saturation, check=check, fallback=fallback, threads=threads,
        max_memory=max_memory,
    )  # fmt: skip
    planned = plan_for(image, log, camera, exposure, options, progress=progress)
    return planned.apply(image, out=out, progress=progress)


def psfs(
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    mode: Mode = "banded",
    bands: Count = "auto",
    strips: Count = "auto",
    nsr: float = NSR,
    motion: Motion = "rotation",
    translation: Translation | None = None,
    softness: float = 0.0,
) -> PsfBank:
    """Return the PSFs that :func:`deblur` would undo, without a picture.

    Parameters
    ----------
    log, camera, exposure, mode, bands, strips
        See :func:`deblur`.
    nsr : float, default 0.01
        Noise-to-signal ratio that decides the automatic numbers of tiles; :func:`deblur` derives it from the picture.
    motion, translation, softness
        See :func:`deblur`.

    Returns
    -------
    PsfBank
        The PSFs, at their places in the picture as stored.

    Raises
    ------
    InputError, CoverageError, ClockError, GapError
        As :func:`deblur`.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(640, 480, 500.0, readout_time=0.03)
    >>> bank = rsdeblur.psfs(log, camera, rsdeblur.Exposure(0.2, 0.05), bands=4, strips=2)
    >>> bank.kernels.shape[:2], float(bank.at(100, 320).sum().round(4))
    ((4, 2), 1.0)
    """
    nsr = validate.strength("nsr", nsr)
    options = Options(mode=mode, bands=bands, strips=strips, motion=motion, translation=translation, softness=softness)
    planned = plan(log, camera, exposure, options)
    return planned.frame.bank(PsfBank.from_paths(planned.tile_paths(nsr)))
