"""The alternatives that the speed benchmark times, behind one interface.

An alternative is built for a :class:`benchmarks.cases.Case` and a number of threads. Building makes its plans and,
where its library can, its filters. It takes the blurred picture (H, W, 3) float32 and returns a deblurred one of that
shape. Alternatives import their library when they are built; a missing library raises ImportError.

The alternatives assume that the picture repeats. That is less work than continuing it beyond its border, and makes
their results comparable with ours for ``border="periodic"`` in every pixel.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pyfftw
import scipy.fft
from numpy.typing import NDArray

from benchmarks.cases import EXPOSURE, NSR, Case, centred
from benchmarks.data import Image
from benchmarks.timing import Job
from rsdeblur import Deconvolver, PsfBank
from rsdeblur.pipeline.deblur import psfs

# MKL reads this when it is loaded. Otherwise its threads stay busy for 0.2 s after each call, on the cores that the
# next alternative needs. MKL's own times are the same with both settings.
os.environ.setdefault("KMP_BLOCKTIME", "0")

# Single precision rounds at 6e-8; the filter amplifies up to 1 / (2 sqrt(NSR)) = 5 times. Measured: below 1e-6.
SAME = 1e-5
# A different border shows far inside, because the filter rings: measured 3e-4 (2048x1536) to 9e-3 (512x384) rms.
RINGING = 0.02
# Patches repeat at their own borders, with one PSF each: measured 0.03 to 0.07; mirrored PSFs give over 0.12.
PATCHED = 0.08
PATCH = 256

GLOBAL, PERIODIC, BARE, SKIMAGE, SKIMAGE_AS_IS, MKL, PATCHES, REPLAN = (
    "ours, global",
    "ours, global, periodic",
    "bare 7 FFTs",
    "scikit-image",
    "scikit-image, as is",
    "MKL-FFT",
    "regularizepsf",
    "motion + PSFs + filters",
)
BANDS = (4, 8, 16, 32, 64)


def banded(bands: int) -> str:
    """Return the name of our alternative with `bands` bands."""
    return f"ours, {bands} bands"


@dataclass(frozen=True)
class Task:
    """A function to time, and the scaling that makes its result comparable."""

    run: Job
    comparable: Callable[[Image], Image] = field(default=lambda picture: picture)


@dataclass(frozen=True)
class Alternative:
    """One row of the table.

    Parameters
    ----------
    build : callable
        Makes the task for a case and a number of threads.
    like : str, optional
        Alternative whose picture this one must give too.
    tolerance : float
        Bound on the difference from `like`, in units of the picture's white.
    measure : {"largest", "rms"}
        Largest difference over the whole picture, or root mean square over its inner part.
    threaded : bool
        Whether the number of threads can be chosen; if not, it is timed once.
    """

    build: Callable[[Case, int], Task]
    like: str | None = None
    tolerance: float = SAME
    measure: Literal["largest", "rms"] = "largest"
    threaded: bool = True


def bare(case: Case, threads: int) -> Task:
    """FFTW's 2-D plans, one transform for the PSF and two per channel: no filter, no border, no copies."""
    # Even lengths with prime factors 2, 3 and 5: FFTW is several times slower for some lengths with factors 11 and 13.
    needed = np.add(case.shape[:2], case.box[::-1])
    height, width = (2 * scipy.fft.next_fast_len(-(-int(n) // 2), real=True) for n in needed)
    spectrum = pyfftw.empty_aligned((height, width // 2 + 1), dtype=np.complex64)
    transforms = []
    for plane in range(4):
        source, target = (pyfftw.zeros_aligned((height, width), dtype=np.float32) for _ in range(2))
        options = {"axes": (0, 1), "flags": ("FFTW_MEASURE", "FFTW_DESTROY_INPUT"), "threads": threads}
        transforms.append(pyfftw.FFTW(source, spectrum, direction="FFTW_FORWARD", **options).execute)
        if plane:
            transforms.append(pyfftw.FFTW(spectrum, target, direction="FFTW_BACKWARD", **options).execute)

    def run() -> None:
        for execute in transforms:
            execute()

    return Task(run)


def ours(bands: int, border: Literal["blend", "periodic"] = "blend") -> Callable[[Case, int], Task]:
    """Our filter: all of `apply`, into a given array."""

    def build(case: Case, threads: int) -> Task:
        solver = Deconvolver(case.bank(bands), case.shape, nsr=NSR, border=border, threads=threads)
        out = np.empty(case.shape, dtype=np.float32)
        return Task(lambda: solver.apply(case.blurred, out=out))

    return build


def motion(bands: int) -> Callable[[Case, int], Task]:
    """Motion and PSFs, from the raw log."""

    def build(case: Case, threads: int) -> Task:
        log = case.log(bands)
        return Task(lambda: psfs(log, case.camera, EXPOSURE, bands=bands, strips=1))

    return build


def replan(bands: int) -> Callable[[Case, int], Task]:
    """Motion, PSFs and filters, from the raw log."""

    def build(case: Case, threads: int) -> Task:
        log = case.log(bands)

        def bank() -> PsfBank:
            return psfs(log, case.camera, EXPOSURE, bands=bands, strips=1)

        def run() -> None:
            Deconvolver(bank(), case.shape, nsr=NSR, threads=threads)

        return Task(run)

    return build


def scipy_wiener(case: Case, threads: int) -> Task:
    """Wiener filter with SciPy's FFT."""
    size, filter_ = case.shape[:2], wiener_filter(case)

    def deblur(plane: Image) -> Image:
        spectrum = scipy.fft.rfft2(plane, workers=threads)
        spectrum *= filter_
        deblurred: Image = scipy.fft.irfft2(spectrum, s=size, workers=threads, overwrite_x=True)
        return deblurred

    return by_channel(deblur, case)


def mkl_wiener(case: Case, threads: int) -> Task:
    """Wiener filter with Intel MKL's FFT."""
    import mkl
    import mkl_fft

    size, filter_ = case.shape[:2], wiener_filter(case)

    def deblur(plane: Image) -> Image:
        mkl.set_num_threads(threads)
        spectrum = mkl_fft.rfft2(plane)
        spectrum *= filter_
        deblurred: Image = mkl_fft.irfft2(spectrum, s=size)
        return deblurred

    return by_channel(deblur, case)


def opencv_wiener(case: Case, threads: int) -> Task:
    """Wiener filter with OpenCV's transform in its packed format, and its product of spectra."""
    import cv2

    response = scipy.fft.irfft2(wiener_filter(case), s=case.shape[:2])
    filter_ = cv2.dft(response)

    def run() -> Image:
        cv2.setNumThreads(threads)
        spectra = (cv2.mulSpectrums(cv2.dft(plane), filter_, 0) for plane in cv2.split(case.blurred))
        deblurred: Image = cv2.merge([cv2.idft(spectrum, flags=cv2.DFT_SCALE) for spectrum in spectra])
        return deblurred

    return Task(run)


def skimage_wiener(case: Case, threads: int) -> Task:
    """`skimage.restoration.wiener`, which makes its filter in each call, with our regulariser, already transformed."""
    from skimage.restoration import wiener

    kernel = case.bank(1).kernels[0, 0]
    identity = np.ones((case.height, case.width // 2 + 1), dtype=np.complex64)

    def run() -> Image:
        with scipy.fft.set_workers(threads):
            planes = [wiener(case.blurred[..., c], kernel, NSR, reg=identity, clip=False) for c in range(3)]
        return np.stack(planes, axis=-1)

    return Task(run, lambda picture: (1 + NSR) * picture)


def skimage_as_is(case: Case, threads: int) -> Task:
    """`skimage.restoration.wiener` with its defaults: it penalises the Laplacian and runs in one thread."""
    from skimage.restoration import wiener

    kernel = case.bank(1).kernels[0, 0]
    return Task(lambda: np.stack([wiener(case.blurred[..., c], kernel, NSR) for c in range(3)], axis=-1))


def regularizepsf_patches(case: Case, threads: int) -> Task:
    """Patches of 256 px, half overlapped, each with the PSF of the nearest of 16 bands."""
    from regularizepsf import ArrayPSF, ArrayPSFTransform
    from regularizepsf.util import IndexedCube, calculate_covering

    bank = case.bank(16)
    corners = [(int(row), int(col)) for row, col in calculate_covering(case.shape[:2], PATCH)]
    nearest = [np.abs(bank.rows - (row + PATCH / 2)).argmin() for row, _ in corners]
    kernels = np.stack([centred(kernel, (PATCH, PATCH)) for kernel in bank.kernels[:, 0]])
    points = np.zeros((len(corners), PATCH, PATCH))
    points[:, 0, 0] = 1.0
    source, target = (ArrayPSF(IndexedCube(corners, values)) for values in (kernels[nearest].astype(float), points))
    # Its regularised reciprocal is conj(H) / (|H|^2 + epsilon^2) for alpha = 1.
    transform = ArrayPSFTransform.construct(source, target, alpha=1.0, epsilon=NSR**0.5)
    # Patches are weighted twice with sin^2, whose squares do not sum to a constant when patches overlap by half.
    weight = np.sin((np.arange(PATCH) + 0.5) * np.pi / PATCH) ** 4
    gains = (np.resize(weight + np.roll(weight, PATCH // 2), n) for n in case.shape[:2])
    gain = np.multiply.outer(*gains).astype(np.float32)[:, :, None]

    def run() -> Image:
        planes = [transform.apply(case.blurred[..., c]) for c in range(3)]
        return np.stack(planes, axis=-1, dtype=np.float32, casting="same_kind")

    return Task(run, lambda picture: (1 + NSR) * picture / gain)


def wiener_filter(case: Case) -> NDArray[np.complex64]:
    """Return the filter of :class:`rsdeblur.Deconvolver` with one PSF, for a picture that repeats."""
    otf = scipy.fft.rfft2(centred(case.bank(1).kernels[0, 0], case.shape[:2]))
    filter_: NDArray[np.complex64] = ((1 + NSR) * otf.conj() / (np.abs(otf) ** 2 + NSR)).astype(np.complex64)
    return filter_


def by_channel(deblur: Callable[[Image], Image], case: Case) -> Task:
    """Return a task that filters each channel as a contiguous plane, which is faster even with the copies."""

    def run() -> Image:
        out = np.empty(case.shape, dtype=np.float32)
        for c in range(case.shape[2]):
            out[..., c] = deblur(np.ascontiguousarray(case.blurred[..., c]))
        return out

    return Task(run)


ALTERNATIVES: dict[str, Alternative] = {
    BARE: Alternative(bare),
    GLOBAL: Alternative(ours(1), like=PERIODIC, tolerance=RINGING, measure="rms"),
    PERIODIC: Alternative(ours(1, "periodic")),
    **{banded(bands): Alternative(ours(bands)) for bands in BANDS},
    "motion + PSFs": Alternative(motion(16), threaded=False),
    REPLAN: Alternative(replan(16)),
    "SciPy FFT": Alternative(scipy_wiener, like=PERIODIC),
    SKIMAGE: Alternative(skimage_wiener, like=PERIODIC),
    SKIMAGE_AS_IS: Alternative(skimage_as_is, threaded=False),
    "OpenCV": Alternative(opencv_wiener, like=PERIODIC),
    MKL: Alternative(mkl_wiener, like=PERIODIC),
    PATCHES: Alternative(regularizepsf_patches, like=banded(16), tolerance=PATCHED, measure="rms", threaded=False),
}
