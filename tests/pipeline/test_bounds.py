"""Bounds of memory, of numbers that float32 does not carry, and of work that the picture's size does not justify.

Warnings are errors, so none of these calls overflows in silence.
"""

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsdeblur import Camera, Deconvolver, Exposure, GyroLog, PsfBank, deblur, deconvolve, find_time_offset, psfs, scene
from rsdeblur.choices import DISTORTIONS, MODES
from rsdeblur.errors import InputError, RsdeblurError
from rsdeblur.pipeline import memory
from rsdeblur.simulation import Simulation
from rsdeblur.simulation.shake import hand_shake
from rsdeblur.simulation.simulate import simulate
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


@pytest.mark.parametrize("prior", ["wiener", "tv"])
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
    # A gyro clock that is later by more has no samples of the exposure; ten years have steps of 60 ns.
    assert found.offsets.max() <= 0.1 + 1e-7
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
def test_any_camera_and_motion_has_psfs_or_is_refused(model, focal, bend, speed, duration, seed):
    rng = np.random.default_rng(seed)
    k = rng.normal(0, 10**bend, 4) * rng.integers(2, size=4) if model != "none" else ()
    log = GyroLog(np.arange(120) * 0.005, rng.normal(0, 10**speed, (120, 3)))
    try:
        camera = Camera(WIDTH, HEIGHT, 10**focal, readout_time=0.03, distortion_model=model, distortion=k)
        bank = psfs(log, camera, Exposure(0.1, 10**duration))
    except RsdeblurError as refusal:
        # No message of a refusal is longer.
        assert len(str(refusal)) < 600  # noqa: PT017, because either is right
    else:
        assert np.isfinite(bank.kernels).all()


# The published method's filter unless a test says otherwise: fast, and linear in the picture.
deblurred = partial(deblur, prior="wiener")

TALL, NARROW = 400, 96
TALL_CAMERA = Camera(NARROW, TALL, 500.0, readout_time=0.03)
SHUTTER = Exposure(0.06, 1 / 50)
BANDS = {"bands": 12, "strips": 2}
ROWS = {"mode": "rowwise", "strips": 2}
# Options, and bytes for which the picture is cut into a few chunks. Priors have their automatic weights.
METHODS = {
    "banded": ({**BANDS, "nsr": 0.02}, 1_700_000),
    "rowwise": ({**ROWS, "nsr": 0.02}, 1_700_000),
    "global tv": ({"mode": "global", "prior": "tv"}, 2_700_000),
    "rowwise tv": ({**ROWS, "prior": "tv"}, 4_000_000),
    "banded tv": ({**BANDS, "prior": "tv"}, 4_000_000),
}


@pytest.fixture(scope="module")
def log() -> GyroLog:
    return hand_shake(0.2, seed=3)


@pytest.fixture(scope="module")
def capture(log: GyroLog) -> Simulation:
    return simulate(scene(TALL + 40, NARROW + 60), log, TALL_CAMERA, SHUTTER, noise=0.003)


@pytest.fixture
def planned(monkeypatch):
    """Record the chunks, without the fixed part of the memory, so that small pictures can be cut."""
    chunks = []

    def plan(*args):
        chunks[:] = plan_chunks(*args)
        return chunks

    plan_chunks = memory.plan_chunks
    monkeypatch.setattr(memory, "FIXED", 0)
    monkeypatch.setattr("rsdeblur.pipeline.steps.plan_chunks", plan)
    return chunks


@pytest.mark.parametrize("name", METHODS)
def test_chunks_give_the_picture_that_is_solved_whole(capture, log, planned, name):
    arguments, (options, most) = (capture.blurred, log, TALL_CAMERA, SHUTTER), METHODS[name]
    whole = deblurred(*arguments, **options)
    assert len(planned) == 1
    sliced = deblurred(*arguments, **options, max_memory=most)
    assert len(planned) > 1
    rows = [row for chunk in planned for row in range(chunk.target.start, chunk.target.stop)]
    assert rows == list(range(TALL))
    assert all(chunk.source.start <= chunk.target.start and chunk.target.stop <= chunk.source.stop for chunk in planned)
    assert (sliced.bands, sliced.strips) == (whole.bands, whole.strips)
    for chunk in planned[1:]:
        near = np.s_[chunk.target.start - 8 : chunk.target.start + 9, 24:-24]
        change = np.sqrt(np.mean((sliced.image - whole.image)[near] ** 2))
        losses = [np.mean((image - capture.rolling)[near] ** 2) for image in (whole.image, sliced.image)]
        # A step of 8 bits, and 0.05 dB. Measured: 0.0022 with one filter for the picture, below 0.0012 otherwise.
        assert change < 0.004
        assert 10 * np.log10(losses[1] / losses[0]) < 0.05


def test_too_little_memory_is_refused_before_the_work(capture, log, monkeypatch):
    monkeypatch.setattr(memory, "FIXED", 0)
    with pytest.raises(InputError, match=r"max_memory is 0 MiB, but even 16 rows of this picture need \d+ MiB"):
        deblurred(capture.blurred, log, TALL_CAMERA, SHUTTER, max_memory=2**18)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_results_are_written_to_out(capture, log, tmp_path, dtype):
    """Also between memory-mapped files; integers are rounded."""
    top = 1 if dtype == np.float32 else np.iinfo(dtype).max
    np.save(tmp_path / "in.npy", (capture.blurred.clip(0, 1) * top).astype(dtype))
    blurred = np.load(tmp_path / "in.npy", mmap_mode="r")
    out = np.lib.format.open_memmap(tmp_path / "out.npy", mode="w+", dtype=dtype, shape=blurred.shape)
    result = deblurred(blurred, log, TALL_CAMERA, SHUTTER, nsr=0.02, out=out)
    assert result.image is out
    expected = deblurred(np.array(blurred), log, TALL_CAMERA, SHUTTER, nsr=0.02).image
    if dtype != np.float32:
        expected = np.rint(expected * np.float32(top))
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), expected)
