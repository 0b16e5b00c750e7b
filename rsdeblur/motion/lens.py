"""Lens distortion: OpenCV's radial-tangential and fisheye models, and their inverses.

Points are in normalised coordinates, (pixel - principal point) / focal length; directions are (x, y, z), z forward.
"""

from functools import lru_cache

import numpy as np

from rsdeblur.choices import Distortion
from rsdeblur.types import FloatArray

# Numbers of coefficients that each model may have: k1 k2 p1 p2 [k3 [k4 k5 k6]] for "radtan", k1 k2 k3 k4 for "fisheye".
COEFFICIENTS: dict[Distortion, tuple[int, ...]] = {"none": (0,), "radtan": (4, 5, 8), "fisheye": (4,)}

# Most steps of Newton's method, which doubles the correct digits in each; ordinary lenses take five.
STEPS = 30
TOLERANCE = 1e-13
# Least slope of the fisheye's polynomial theta_d(theta). Below it, the polynomial is about to decrease.
FLAT = 0.1


def project(directions: FloatArray, model: Distortion, k: tuple[float, ...]) -> FloatArray:
    """Return the points (..., 2) to which the lens projects directions (..., 3); NaN where it does not see them."""
    x, y, z = np.moveaxis(directions, -1, 0)
    if model == "fisheye":
        # theta_d = theta (1 + k1 theta^2 + ...), Kannala and Brandt (2006); sin(theta)/theta is regular at 0.
        across = np.hypot(x, y)
        theta = np.arctan2(across, z)
        ratio = _fisheye(theta, k)[0] / np.where(across > 0, across, 1.0)
        ratio = np.where(across > 0, ratio, 1.0 / np.where(across > 0, 1.0, z))
        return np.stack([x * ratio, y * ratio], axis=-1)
    z = np.where(z > 0, z, np.nan)
    plane = np.stack([x / z, y / z], axis=-1)
    return plane if model == "none" else _radtan(plane, k)[0]


def rays(points: FloatArray, model: Distortion, k: tuple[float, ...]) -> FloatArray:
    """Return the directions (..., 3) that the lens projects to points (..., 2); NaN where the lens has no image."""
    if model == "fisheye":
        bent = np.linalg.norm(points, axis=-1)
        with np.errstate(all="ignore"):
            theta = _straightened(bent, k)
        ratio = np.sin(theta) / np.where(bent > 0, bent, 1.0)
        ratio = np.where(bent > 0, ratio, 1.0)
        return np.stack([points[..., 0] * ratio, points[..., 1] * ratio, np.cos(theta)], axis=-1)
    # Where no direction leads to a point, Newton's method diverges, perhaps to infinity; the result is checked.
    with np.errstate(all="ignore"):
        plane = points if model == "none" else _flattened(points, k)
    return np.concatenate([plane, np.ones_like(plane[..., :1])], axis=-1)


@lru_cache
def _fold(k: tuple[float, ...]) -> float:
    """Return the angle at which the slope of the fisheye's polynomial falls to `FLAT`; infinity if it never does."""
    slope = [1.0 - FLAT, *((2 * i + 3) * value for i, value in enumerate(k))]
    # `roots` divides by the highest coefficient. Up to 1e-12, it adds less than 1e-8 to the slope at 180 degrees.
    squares = np.polynomial.Polynomial(slope).trim(1e-12).roots()
    real = squares.real[(np.abs(squares.imag) < 1e-9) & (squares.real > 0)]
    return float(np.sqrt(real.min())) if real.size else float("inf")


def reach(k: tuple[float, ...]) -> float:
    """Return the distance from the principal point up to which the fisheye model with `k` is invertible."""
    fold = np.float64(_fold(k))
    return float(_fisheye(fold, k)[0]) if np.isfinite(fold) else float("inf")


def _fisheye(theta: FloatArray | np.float64, k: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Return theta_d and its derivative.

    Calibrations often do not reach the corners of the picture, and their polynomials may decrease there, which no real
    lens does. From `_fold` on, the model continues along the tangent.
    """
    inside = np.minimum(theta, _fold(k))
    square = inside**2
    bent, slope = np.ones_like(square), np.ones_like(square)
    power = np.ones_like(square)
    for i, coefficient in enumerate(k):
        power = power * square
        bent = bent + coefficient * power
        slope = slope + (2 * i + 3) * coefficient * power
    return inside * bent + slope * (theta - inside), slope


def _straightened(bent: FloatArray, k: tuple[float, ...]) -> FloatArray:
    """Return theta for values `bent` of theta_d; NaN where the lens has no image."""
    # Newton's method begins nearly right: theta_d increases, see `_fisheye`.
    table = np.linspace(0.0, np.pi, 4096)
    theta = np.interp(bent, _fisheye(table, k)[0], table)
    for _ in range(STEPS):
        value, slope = _fisheye(theta, k)
        step = (value - bent) / slope
        theta = theta - step
        if np.abs(step).max(initial=0.0) < TOLERANCE:
            break
    right = (np.abs(_fisheye(theta, k)[0] - bent) <= 1e-9) & (theta >= 0) & (theta <= np.pi)
    return np.where(right, theta, np.nan)


def _radtan(plane: FloatArray, k: tuple[float, ...]) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """Return the distorted points, and the Jacobian's xx, xy = yx, and yy: Brown (1971), OpenCV's denominator."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*k, *(0.0,) * (8 - len(k)))
    x, y = plane[..., 0], plane[..., 1]
    r2 = x * x + y * y
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    radial = above / below
    # derivative of `radial` by r2
    slope = (k1 + r2 * (2 * k2 + r2 * 3 * k3)) / below - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6)) / below
    bent = np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )
    cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    along_x = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    along_y = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return bent, (along_x, cross, along_y)


def _flattened(points: FloatArray, k: tuple[float, ...]) -> FloatArray:
    """Return the undistorted points for distorted `points`; NaN where the lens has no image."""
    plane = points
    for _ in range(STEPS):
        bent, (xx, xy, yy) = _radtan(plane, k)
        ex, ey = np.moveaxis(bent - points, -1, 0)
        # Cramer's rule. On a fold the determinant vanishes; such a point is marked invalid below.
        determinant = xx * yy - xy * xy
        step = np.stack([yy * ex - xy * ey, xx * ey - xy * ex], axis=-1)
        step = step / np.where(determinant == 0, np.inf, determinant)[..., None]
        plane = plane - step
        if np.abs(step).max(initial=0.0) < TOLERANCE:
            break
    bent, (xx, xy, yy) = _radtan(plane, k)
    # Beyond a fold the solution may be mirrored in one direction or in both.
    folded = (xx * yy - xy * xy <= 0) | (xx + yy <= 0)
    wrong = folded | ~(np.abs(bent - points).max(axis=-1) < 1e-9)
    return np.where(wrong[..., None], np.nan, plane)


def turned(model: Distortion, k: tuple[float, ...]) -> tuple[float, ...]:
    """Return the coefficients for the picture turned a quarter clockwise."""
    return (*k[:2], k[3], -k[2], *k[4:]) if model == "radtan" else k


def fisheye_of_fov(omega: float, edge: float) -> list[float]:
    """Return the fisheye that Devernay's FOV lens (2001) is: the factor of its focal length, and k1 to k4.

    They fit its radii up to `edge` in normalised coordinates, at most nearly 90 degrees from the axis.
    """
    wide = 2 * np.tan(omega / 2)
    theta = np.linspace(0, np.arctan(np.tan(min(omega * edge, 1.5)) / wide), 200)[1:]
    bent = np.arctan(wide * np.tan(theta)) / omega
    scale, *k = np.linalg.lstsq(theta[:, None] ** [1, 3, 5, 7, 9], bent, rcond=None)[0].tolist()
    return [scale, *(value / scale for value in k)]
