"""Bounds of what is computed: numbers that float32 does not carry, and work that the picture's size does not justify.

Warnings are errors, so none of these calls overflows in silence.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsdeblur import (
    Camera,
    Deconvolver,
    Exposure,
    GyroLog,
    InputError,
    PsfBank,
    RsdeblurError,
    deblur,
    deconvolve,
    find_time_offset,
    hand_shake,
    psfs,
    scene,
    simulate,
)
from rsdeblur.choices import DISTORTIONS, MODES
from tests.installed import PRIORS

HEIGHT, WIDTH = 36, 48
LOG = hand_shake(0.2, strength=1.0, seed=3)
CAMERA = Camera(WIDTH, HEIGHT, 60.0, readout_time=0.03)
EXPOSURE = Exposure(0.05, 0.025)
NOISE = np.random.default_rng(0).random((HEIGHT, WIDTH, 3), dtype=np.float32)
KERNEL = np.full((1, 5), 0.2)


def run(image: Any = NOISE, **options: Any) -> Any:
    return deblur(image, LOG, CAMERA, EXPOSURE, **options)


@pytest.mark.parametrize(("noise", "options"), [(0.0, {}), (1e-40, {"weight": 1e-20}), (1e12, {"weight": 1e20})])
@pytest.mark.parametrize("prior", PRIORS)
def test_any_noise_has_a_finite_result(prior: str, noise: float, options: dict[str, Any]) -> None:
    if prior == "wiener":  # It has no weight.
        options = {"nsr" if name == "weight" else name: value for name, value in options.items()}
    assert np.isfinite(deconvolve(NOISE, KERNEL, prior=prior, noise=noise, **options).image).all()


@pytest.mark.parametrize("prior", ["wiener", "tv", "wavelet"])
@pytest.mark.parametrize("mode", MODES)
def test_the_largest_strengths_have_a_finite_result(mode: str, prior: str) -> None:
    for value in (1e-20, 1e20):
        strengths = {"nsr": value} if prior == "wiener" else {"nsr": value, "weight": value}
        assert np.isfinite(run(mode=mode, prior=prior, **strengths).image).all()


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize(("mode", "scale"), [*zip(MODES, (1e12, 1e-45, 1e12), strict=True)])
def test_pictures_of_any_scale_have_a_finite_result(mode: str, prior: str, scale: float) -> None:
    assert np.isfinite(run(NOISE * np.float32(scale), mode=mode, prior=prior).image).all()


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("mode", ["banded", "rowwise"])
def test_one_bright_pixel_has_a_finite_result(mode: str, prior: str) -> None:
    image = NOISE.copy()
    image[20, 30] = 1e12
    assert np.isfinite(run(image, mode=mode, prior=prior).image).all()


@pytest.mark.parametrize("transfer", [0.1, 10.0])
def test_a_result_that_is_not_finite_is_refused(transfer: float) -> None:
    image = NOISE * np.float32(1e11 if transfer < 1 else 1.0)
    try:
        assert np.isfinite(run(image, transfer=transfer, prior="wiener", nsr=1e-6).image).all()
    except InputError as error:
        assert "the result is not finite" in str(error)  # noqa: PT017, because either is right


@pytest.mark.parametrize("options", [{"weight": 1e20}, {"prior": "gradient", "weight": 1e20}])
def test_an_even_result_is_not_good(options: dict[str, Any]) -> None:
    """The strongest smoothing leaves nothing of the picture, which no other figure of the check shows."""
    log, camera = hand_shake(0.2, strength=1.0, seed=3), Camera(4 * WIDTH, 4 * HEIGHT, 240.0, readout_time=0.03)
    texture = np.kron(NOISE, np.ones((4, 4, 1), np.float32))
    check = deblur(texture, log, camera, EXPOSURE, **options).check
    assert check is not None
    assert check.verdict != "good"
    assert "lost" in check.reasons[-1]


# No message of a refusal is longer.
LONGEST_LINE = 300


def test_a_tiny_nsr_counts_as_what_float32_carries() -> None:
    bank = PsfBank.for_picture(np.full((1, 5), 0.2), (HEIGHT, WIDTH))
    light = NOISE[..., 0]
    least, tiny = (Deconvolver(bank, light.shape, nsr=nsr).apply(light) for nsr in (1e-6, 1e-16))
    np.testing.assert_array_equal(least, tiny)


def test_the_search_ends_where_the_log_does() -> None:
    """Ten years are searched as fast as the log: what it does not cover takes no time."""
    log = hand_shake(0.2, strength=1.0, seed=3)
    tried: list[str] = []
    sheet = simulate(scene(64, 80)[..., 1], log, Camera(80, 64, 90.0, readout_time=0.03), Exposure(0.1, 0.05)).blurred
    found = find_time_offset(
        *(sheet, log, Camera(80, 64, 90.0, readout_time=0.03), Exposure(0.1, 0.05)),
        search=(-3e8, 3e8),
        progress=lambda stage, _: tried.append(stage),
    )
    # 120 ms are covered: 31 coarse steps, two that are not, and the windows of the fine search.
    assert len(tried) < 31 + 2 + 9 * 8
    assert -0.2 < found.best < 0.2
    day = GyroLog(np.arange(0.0, 300, 0.02), np.zeros((15_000, 3)))
    with pytest.raises(InputError, match="search must span at most 120 s of the log"):
        find_time_offset(sheet, day, Camera(80, 64, 90.0), Exposure(150.0, 0.05), search=(-100, 100))


def test_a_lens_that_sees_everything_has_psfs() -> None:
    whole_sphere = Camera(160, 120, 100 / np.pi, distortion_model="fisheye", distortion=(0, 0, 0, 0))
    assert np.isfinite(psfs(hand_shake(0.2, strength=0.01), whole_sphere, EXPOSURE).kernels).all()


@settings(derandomize=True, deadline=None, max_examples=25)
@given(
    st.sampled_from(DISTORTIONS),
    st.floats(-2, 5),
    st.floats(-4, 1),
    st.floats(-3, 6),
    st.floats(-4, -0.7),
    st.integers(0, 2**32 - 1),
)
@pytest.mark.filterwarnings("ignore:gyro rates look like degrees", "ignore:a focal length of")
def test_any_camera_and_motion_has_psfs_or_is_refused(
    model: Any, focal: float, bend: float, speed: float, duration: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    k = rng.normal(0, 10**bend, 4) * rng.integers(2, size=4) if model != "none" else ()
    log = GyroLog(np.arange(120) * 0.005, rng.normal(0, 10**speed, (120, 3)))
    try:
        camera = Camera(WIDTH, HEIGHT, 10**focal, readout_time=0.03, distortion_model=model, distortion=k)
        bank = psfs(log, camera, Exposure(0.1, 10**duration))
    except RsdeblurError as refusal:
        assert len(str(refusal)) < 2 * LONGEST_LINE  # noqa: PT017, because either is right
    else:
        assert np.isfinite(bank.kernels).all()
