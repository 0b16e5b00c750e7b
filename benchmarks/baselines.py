"""Published deconvolution methods as baselines for experiments, with one PSF for the whole picture.

All take a picture in linear light, (H, W) or (H, W, C), and return float32 of the same shape. All treat borders alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.fft
import scipy.signal
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from skimage import restoration
from skimage.transform import resize

from benchmarks.paper.continuations import tapered
from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

Image = NDArray[np.float32]

# Continuation of TV-L1: both quadratic penalties start loose and are halved until they act as hard constraints.
LOOSEST, TIGHTEST = 1.0, 2.0**-9

# Blind estimation: scale between pyramid levels, rounds per level, the smallest kernel and the part of the picture that
# is used (px). A larger part is slower, and kernels do not improve beyond a part of about 20 times their size.
PYRAMID_STEP = 2**0.5
ROUNDS = 6
SMALLEST_KERNEL = 5
USED_PART = 384
# Weight of each non-zero gradient, for light in [0, 1]: the first, its decay per round, and the least.
L0_WEIGHT, L0_DECAY, L0_LEAST = 4e-3, 1.1, 1e-4
# Splitting penalty: doubled from 2 weights up to this value, at which gradients are either kept whole or removed.
L0_TIGHTEST = 1e4
# Gradients kept in the direction (of four) that has the fewest, in units of sqrt(picture pixels x kernel pixels).
KEPT = 2.0
# Regularisation of the kernel, as a share of the mean spectral power.
KERNEL_WEIGHT = 0.02
# Noise: kernel values below the first share of the peak, and connected parts below the second share of the largest
# part's mass.
KERNEL_FLOOR, SPECK = 0.05, 0.1


def richardson_lucy(image: ArrayLike, psf: ArrayLike, *, iterations: int = 30) -> Image:
    """Deconvolve by Richardson and Lucy's iteration (scikit-image); negative light is set to 0.

    Raises
    ------
    InputError
        If the picture or the PSF is invalid, or the PSF is larger than the picture.
    """
    iterations = validate.count("iterations", iterations)

    def solve(plane: FloatArray, kernel: FloatArray) -> FloatArray:
        return np.asarray(restoration.richardson_lucy(plane.clip(0.0), kernel, num_iter=iterations, clip=False))

    return _each(image, psf, solve)


def unsupervised_wiener(image: ArrayLike, psf: ArrayLike, *, seed: int = 0) -> Image:
    """Deconvolve with a Wiener filter that estimates its own noise level (Orieux et al. 2010, scikit-image).

    Raises
    ------
    InputError
        As :func:`richardson_lucy`.
    """
    seed = validate.count("seed", seed, minimum=0)

    def solve(plane: FloatArray, kernel: FloatArray) -> FloatArray:
        return np.asarray(restoration.unsupervised_wiener(plane, kernel, clip=False, rng=seed)[0])

    return _each(image, psf, solve)


def tv_l1(image: ArrayLike, psf: ArrayLike, *, weight: float = 0.005) -> Image:
    """Minimise `sum |h * u - g| + weight sum |grad u|` by alternating minimisation (Xu and Jia 2010, 4).

    Half-quadratic splitting: with `v` for the residual and `w` for the gradient,

        sum |h * u - g - v|^2 / (2 beta) + |v| + |grad u - w|^2 / (2 theta) + weight |w|

    is minimised in turn for `v` and `w`, by shrinking, and for `u`, in the Fourier domain; both penalties are halved
    from 1 to 1/512.

    Parameters
    ----------
    weight : float, default 0.005
        Weight of the total variation, positive; a larger one gives a smoother result.

    Raises
    ------
    InputError
        As :func:`richardson_lucy`.
    """
    weight = validate.finite("weight", weight, above=0.0)

    def solve(plane: FloatArray, kernel: FloatArray) -> FloatArray:
        h, dx, dy = _otfs(kernel, plane.shape)
        power, slope = np.abs(h) ** 2, np.abs(dx) ** 2 + np.abs(dy) ** 2
        observed = scipy.fft.rfft2(plane)
        u = observed
        beta = LOOSEST
        while beta > TIGHTEST:
            v = _shrunk(_inverse(h * u - observed, plane.shape), beta)
            target = np.conj(h) * (observed + scipy.fft.rfft2(v)) / beta
            theta = LOOSEST
            while theta > max(beta / 8, TIGHTEST):
                gx, gy = (_inverse(d * u, plane.shape) for d in (dx, dy))
                share = _shrunk(np.hypot(gx, gy), weight * theta) / np.maximum(np.hypot(gx, gy), 1e-12)
                grad_adjoint = np.conj(dx) * scipy.fft.rfft2(gx * share) + np.conj(dy) * scipy.fft.rfft2(gy * share)
                u = (target + grad_adjoint / theta) / (power / beta + slope / theta)
                theta /= 4
            beta /= 2
        return _inverse(u, plane.shape)

    return _each(image, psf, solve)


def estimate_psf(image: ArrayLike, size: int) -> Image:
    """Estimate one PSF from a blurred picture alone, coarse to fine.

    Each level repeats three steps. The picture is deconvolved under a penalty on the *number* of its gradients, which
    leaves only salient edges (Xu, Zheng and Jia 2013). The strongest gradients are kept, evenly over directions (Cho
    and Lee 2009, 2.2). Regularised least squares finds the kernel that turns these gradients into those of the blurred
    picture.

    Parameters
    ----------
    image : array_like
        Linear light.
    size : int
        Size of the kernel in px: odd, at least 5, and not smaller than the blur.

    Returns
    -------
    ndarray, shape (size, size), float32
        The PSF: not negative, sum 1, its centroid at the centre.

    Raises
    ------
    InputError
        If `size` is even or too small, or the picture is smaller than four kernels.
    """
    size = validate.count("size", size, minimum=SMALLEST_KERNEL)
    planes = _planes(image)
    if size % 2 == 0:
        raise InputError(f"size must be odd, got {size}")
    if 4 * size > min(planes.shape[:2]):
        raise InputError(f"the picture must be at least four kernels of {size} px wide and high, got {planes.shape}")
    y, x = (max(0, n - USED_PART) // 2 for n in planes.shape[:2])
    grey = planes[y : y + USED_PART, x : x + USED_PART].mean(axis=2)
    # The start is two pixels side by side, because a single pixel (no blur) is a fixed point of the iteration.
    kernel = np.zeros((SMALLEST_KERNEL, SMALLEST_KERNEL))
    kernel[SMALLEST_KERNEL // 2, SMALLEST_KERNEL // 2 : SMALLEST_KERNEL // 2 + 2] = 0.5
    weight = L0_WEIGHT
    for level in range(round(np.log(size / SMALLEST_KERNEL) / np.log(PYRAMID_STEP)), -1, -1):
        scale = PYRAMID_STEP**-level
        width = min(size, max(SMALLEST_KERNEL, int(size * scale) // 2 * 2 + 1))
        kernel = np.asarray(resize(kernel, (width, width), order=1)).clip(0.0)
        kernel /= kernel.sum()
        shape = tuple(round(n * scale) for n in grey.shape)
        blurred = np.asarray(resize(grey, shape, anti_aliasing=True)) if level else grey
        blurred = _tapered(blurred, np.full((width, width), 1 / width**2))
        for _ in range(ROUNDS):
            kernel = _kernel(blurred, _salient(_few_gradients(blurred, kernel, weight), width), width)
            weight = max(weight / L0_DECAY, L0_LEAST)
    return kernel.astype(np.float32)


def _differences(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.roll(u, -1, 1) - u, np.roll(u, -1, 0) - u


def _few_gradients(blurred: FloatArray, kernel: FloatArray, weight: float) -> FloatArray:
    """Minimise `sum |h * u - g|^2 + weight (number of gradients)` by half-quadratic splitting."""
    h, dx, dy = _otfs(kernel, blurred.shape)
    power, slope = np.abs(h) ** 2, np.abs(dx) ** 2 + np.abs(dy) ** 2
    observed = np.conj(h) * scipy.fft.rfft2(blurred)
    u, beta = blurred, 2 * weight
    while beta < L0_TIGHTEST:
        gx, gy = _differences(u)
        whole = gx**2 + gy**2 >= weight / beta
        gx, gy = gx * whole, gy * whole
        divergence = np.roll(gx, 1, 1) - gx + np.roll(gy, 1, 0) - gy
        u = _inverse((observed + beta * scipy.fft.rfft2(divergence)) / (power + beta * slope), blurred.shape)
        beta *= 2
    return u


def _salient(u: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Keep the strongest gradients, with a threshold that leaves enough of them in each of four directions."""
    gx, gy = _differences(u)
    size = np.hypot(gx, gy)
    direction = np.floor(np.mod(np.arctan2(gy, gx), np.pi) / (np.pi / 4)).astype(int) % 4
    count = round(KEPT * width * np.sqrt(size.size))
    threshold = np.inf
    for k in range(4):
        members = np.sort(size[(direction == k) & (size > 0)])
        if len(members):
            threshold = min(threshold, members[-min(count, len(members))])
    return gx * (size >= threshold), gy * (size >= threshold)


def _kernel(blurred: FloatArray, gradients: tuple[FloatArray, FloatArray], size: int) -> FloatArray:
    """Return the kernel that turns `gradients` into those of `blurred`, by least squares."""
    (fx, fy), (bx, by) = (tuple(map(scipy.fft.rfft2, pair)) for pair in (gradients, _differences(blurred)))
    power = np.abs(fx) ** 2 + np.abs(fy) ** 2
    ratio = (np.conj(fx) * bx + np.conj(fy) * by) / (power + KERNEL_WEIGHT * power.mean())
    whole = np.roll(_inverse(ratio, blurred.shape), (size // 2, size // 2), axis=(0, 1))
    kernel = whole[:size, :size].clip(0.0)
    kernel[kernel < KERNEL_FLOOR * kernel.max()] = 0.0
    # Specks away from the trail are noise.
    parts, count = ndimage.label(kernel > 0, np.ones((3, 3)))
    if count > 1:
        mass = ndimage.sum_labels(kernel, parts, np.arange(1, count + 1))
        kernel[np.isin(parts, 1 + np.flatnonzero(mass < SPECK * mass.max()))] = 0.0
    total = kernel.sum()
    if total <= 0:
        kernel[size // 2, size // 2] = total = 1.0
    return _centred(kernel / total)


def _centred(kernel: FloatArray) -> FloatArray:
    """Shift a kernel by whole pixels until its centroid is at its centre; the picture moves the other way."""
    middle = ndimage.center_of_mass(kernel)
    moved = ndimage.shift(kernel, [n // 2 - round(m) for n, m in zip(kernel.shape, middle, strict=True)], order=0)
    return np.asarray(moved / moved.sum())


def kernel_similarity(a: ArrayLike, b: ArrayLike) -> float:
    """Return the largest normalised cross-correlation of two kernels over all shifts: 1 for equal shapes."""
    one, two = (validate.real_array("kernel", kernel, (None, None)) for kernel in (a, b))
    correlation = scipy.signal.correlate(one, two, mode="full")
    return float(correlation.max() / np.sqrt((one**2).sum() * (two**2).sum()))


def _each(image: ArrayLike, psf: ArrayLike, solve: Callable[[FloatArray, FloatArray], FloatArray]) -> Image:
    """Run `solve` on every channel, mirrored and tapered beyond the frame, and cut the frame out."""
    planes = _planes(image)
    kernel = PsfBank.for_picture(validate.real_array("psf", psf, (None, None)), planes.shape).kernels[0, 0]
    kernel = kernel.astype(np.float64)
    if kernel.shape[0] > planes.shape[0] or kernel.shape[1] > planes.shape[1]:
        raise InputError(f"the PSF of shape {kernel.shape} is larger than the picture of shape {planes.shape[:2]}")
    # The taper changes the outer half of what is added; the inner half continues the picture.
    down, across = (2 * n for n in kernel.shape)
    out = []
    for plane in np.moveaxis(planes, -1, 0):
        padded = _tapered(np.pad(plane, ((down, down), (across, across)), mode="symmetric"), kernel)
        out.append(solve(padded, kernel)[down:-down, across:-across])
    return np.stack(out, axis=-1).reshape(np.shape(image)).astype(np.float32)


def _planes(image: ArrayLike) -> FloatArray:
    picture = validate.real_array("image", image)
    if picture.ndim not in (2, 3) or not picture.size:
        raise InputError(f"image must have shape (H, W) or (H, W, C), got {picture.shape}")
    return picture if picture.ndim == 3 else picture[:, :, None]


def _tapered(plane: FloatArray, kernel: FloatArray) -> FloatArray:
    return tapered(plane[:, :, None].astype(np.float32), kernel)[:, :, 0].astype(np.float64)


def _otfs(kernel: FloatArray, shape: tuple[int, ...]) -> tuple[NDArray[np.complex128], ...]:
    """Return the transfer functions of the kernel and of differences along x and y."""
    otfs = []
    for part in (kernel, np.array([[1.0, -1.0, 0.0]]), np.array([[1.0], [-1.0], [0.0]])):
        whole = np.zeros(shape)
        whole[: part.shape[0], : part.shape[1]] = part
        otfs.append(scipy.fft.rfft2(np.roll(whole, [-(n // 2) for n in part.shape], axis=(0, 1))))
    return tuple(otfs)


def _inverse(spectrum: NDArray[np.complex128], shape: tuple[int, ...]) -> FloatArray:
    return np.asarray(scipy.fft.irfft2(spectrum, s=shape))


def _shrunk(values: FloatArray, threshold: float) -> FloatArray:
    return np.sign(values) * np.maximum(np.abs(values) - threshold, 0.0)
