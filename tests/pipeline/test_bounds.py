"""Bounds of what is computed: numbers that float32 does not carry, and work that the picture's size does not justify.

Warnings are errors, so none of these calls overflows in silence.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, InputError, deblur
from rsdeblur.choices import MODES, PRIORS
from rsdeblur.simulation.shake import hand_shake

HEIGHT, WIDTH = 36, 48
LOG = hand_shake(0.2, strength=1.0, seed=3)
CAMERA = Camera(WIDTH, HEIGHT, 60.0, readout_time=0.03)
EXPOSURE = Exposure(0.05, 0.025)
NOISE = np.random.default_rng(0).random((HEIGHT, WIDTH, 3), dtype=np.float32)


def run(image: Any = NOISE, **options: Any) -> Any:
    return deblur(image, LOG, CAMERA, EXPOSURE, **options)


@pytest.mark.parametrize("value", [0.0, 1e-21, 1e21, 1e38, 1e39, 1e300, np.inf, np.nan])
@pytest.mark.parametrize("name", ["nsr", "weight"])
def test_strengths_that_float32_does_not_carry_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"^{name} must be"):
        run(**{name: value})


@pytest.mark.parametrize("value", [1e-20, 1e20])
@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("mode", MODES)
def test_the_largest_strengths_have_a_finite_result(mode: str, prior: str, value: float) -> None:
    assert np.isfinite(run(mode=mode, prior=prior, nsr=value, weight=value).image).all()


@pytest.mark.parametrize("value", [2e12, -2e12, 3e38, 1e300, np.inf, np.nan])
@pytest.mark.parametrize("options", [{}, {"weight": 0.01}, {"prior": "wiener", "nsr": 0.01}, {"mode": "rowwise"}])
def test_one_pixel_that_float32_does_not_carry_is_refused(options: dict[str, Any], value: float) -> None:
    image = NOISE.astype(np.float64)
    image[7, 9, 1] = value
    with pytest.raises(InputError, match="^image must"):
        run(image, **options)


@pytest.mark.parametrize("scale", [1e12, 1e-12, 1e-38, 1e-45])
@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("mode", MODES)
def test_pictures_of_any_scale_have_a_finite_result(mode: str, prior: str, scale: float) -> None:
    assert np.isfinite(run(NOISE * np.float32(scale), mode=mode, prior=prior).image).all()


@pytest.mark.parametrize("transfer", [0.0, 1e-300, 0.09, 11.0, 1e300])
def test_a_gamma_that_float32_does_not_carry_is_refused(transfer: float) -> None:
    with pytest.raises(InputError, match="^transfer must be"):
        run(transfer=transfer)


@pytest.mark.parametrize("transfer", [0.1, 10.0])
def test_a_result_that_is_not_finite_is_refused(transfer: float) -> None:
    image = NOISE * np.float32(1e11 if transfer < 1 else 1.0)
    try:
        assert np.isfinite(run(image, transfer=transfer, prior="wiener", nsr=1e-6).image).all()
    except InputError as error:
        assert "the result is not finite" in str(error)  # noqa: PT017, because either is right


def test_floats_that_integers_would_make_white_are_refused() -> None:
    with pytest.raises(InputError, match="most of them beyond 1"):
        run(NOISE * np.float32(65535), out=np.empty_like(NOISE, dtype=np.uint8))


@pytest.mark.parametrize("options", [{"weight": 1e20}, {"prior": "gradient", "weight": 1e20}])
def test_an_even_result_is_not_good(options: dict[str, Any]) -> None:
    """The strongest smoothing leaves nothing of the picture, which no other figure of the check shows."""
    log, camera = hand_shake(0.2, strength=1.0, seed=3), Camera(4 * WIDTH, 4 * HEIGHT, 240.0, readout_time=0.03)
    texture = np.kron(NOISE, np.ones((4, 4, 1), np.float32))
    check = deblur(texture, log, camera, EXPOSURE, **options).check
    assert check is not None
    assert check.verdict != "good"
    assert "lost" in check.reasons[-1]
