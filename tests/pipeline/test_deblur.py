"""Quality and invariants of deblur() on simulated captures."""

import warnings
from functools import partial

import numpy as np
import pytest
from scipy import ndimage
from skimage.metrics import peak_signal_noise_ratio

import rsdeblur
from rsdeblur import Camera, Exposure, GyroLog, InputError, PsfBank, RsdeblurWarning, deconvolve, hand_shake, psfs
from rsdeblur.deconv import tiling
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.simulation import Simulation
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.simulate import simulate
from tests.installed import PRIORS

# Unless a test says otherwise: the published method's filter, which is fast and linear in the picture, and no check,
# which changes no picture and has its own tests.
deblur = partial(rsdeblur.deblur, prior="wiener", check=False)

EXPOSURE = Exposure(0.05, 0.025)
CAMERA = Camera(192, 160, 210.0, readout_time=0.03)


def psnr(truth: np.ndarray, image: np.ndarray, border: int = 16) -> float:
    inside = np.s_[border:-border, border:-border]
    return float(peak_signal_noise_ratio(truth[inside], image.clip(0, 1)[inside], data_range=1.0))


@pytest.fixture(scope="module")
def log() -> GyroLog:
    return hand_shake(0.2, strength=1.5, seed=3)


@pytest.fixture(scope="module")
def capture(log: GyroLog) -> Simulation:
    """Simulate a capture whose blur changes a lot down the picture; at 60 dB, errors of the model exceed the noise."""
    return simulate(scene(220, 250), log, CAMERA, EXPOSURE, noise=0.001)


def test_banded_beats_global_and_the_input(capture: Simulation, log: GyroLog) -> None:
    blurred = psnr(capture.rolling, capture.blurred)
    one = psnr(capture.rolling, deblur(capture.blurred, log, CAMERA, EXPOSURE, mode="global", nsr=0.01).image)
    many = psnr(capture.rolling, deblur(capture.blurred, log, CAMERA, EXPOSURE, mode="banded", nsr=0.01).image)
    # Measured 18.2, 17.2 and 26.7 dB; no engine with an error of a sign or of time reaches half of that gain.
    assert many > max(one, blurred) + 4


def test_the_motion_chooses_the_mode(capture: Simulation, log: GyroLog) -> None:
    strong, calm = (GyroLog(log.t, factor * log.omega) for factor in (2.0, 0.1))

    def result(log: GyroLog = strong, **kwargs: object) -> DeblurResult:
        return rsdeblur.deblur(capture.blurred[..., 1], log, CAMERA, EXPOSURE, check=False, **kwargs)

    chosen, same = result(), result(mode="rowwise")
    assert (chosen.mode, result(calm).mode) == ("rowwise", "banded")
    np.testing.assert_array_equal(chosen.image, same.image)
    assert chosen.tile_error == same.tile_error > 0.1 > result(calm).tile_error
    # Bands, a border that rows do not take, and the fast quality choose tiles.
    for kwargs in ({"bands": 4}, {"border": "unknown"}, {"quality": "fast"}):
        assert result(**kwargs).mode == "banded"


def test_softness_of_the_lens_is_undone(capture: Simulation, log: GyroLog) -> None:
    """In every mode; the readout along x is the same problem turned."""
    soft = ndimage.gaussian_filter(capture.blurred, (0.8, 0.8, 0))

    def quality(mode: str, softness: float) -> float:
        kwargs = {"mode": mode, "nsr": 0.003, "softness": softness}
        return psnr(capture.rolling, deblur(soft, log, CAMERA, EXPOSURE, **kwargs).image)

    for mode in ("banded", "rowwise"):
        # Measured 22.5 and 25.0 dB in tiles, 22.7 and 25.2 dB row by row.
        assert quality(mode, 0.8) > quality(mode, 0.0) + 1.5
    result = deblur(soft, log, CAMERA, EXPOSURE, softness=0.8)
    assert result.psfs.softness == 0.8
    turned = Camera(160, 192, 210.0, readout_time=0.03, readout_direction="left-right")
    assert psfs(log, turned, EXPOSURE, softness=0.5).softness == 0.5


def test_rowwise_beats_banded(capture: Simulation, log: GyroLog) -> None:
    def quality(nsr: float, **kwargs: object) -> float:
        return psnr(capture.rolling, deblur(capture.blurred, log, CAMERA, EXPOSURE, nsr=nsr, strips=6, **kwargs).image)

    # With a tiny nsr, errors of the model show; measured 22.1 and 24.2 dB.
    assert quality(1e-4, mode="rowwise") > quality(1e-4, bands=16) + 0.7
    # Each at its best strengths; measured 27.5 and 28.0 dB.
    assert quality(0.001, mode="rowwise", prior="gradient", weight=0.002) > quality(0.003, bands=16) + 0.3


def test_rowwise_reports_its_rows(capture: Simulation, log: GyroLog) -> None:
    grey = capture.blurred[..., 1]
    result = deblur(grey, log, CAMERA, EXPOSURE, mode="rowwise", bands=3, strips=2)
    assert (result.bands, result.strips) == (CAMERA.height, 2)
    bank = psfs(log, CAMERA, EXPOSURE, mode="rowwise", strips=2)
    np.testing.assert_array_equal(bank.kernels, result.psfs.kernels)
    assert result.coverage.all()


def test_one_band_equals_global(capture: Simulation, log: GyroLog) -> None:
    one = deblur(capture.blurred, log, CAMERA, EXPOSURE, mode="banded", bands=1, strips=1)
    whole = deblur(capture.blurred, log, CAMERA, EXPOSURE, mode="global", bands=7, strips=3)
    assert (whole.bands, whole.strips) == (1, 1)
    np.testing.assert_allclose(one.image, whole.image, atol=1e-6)


def test_rectify_matches_the_rectified_reference(capture: Simulation, log: GyroLog) -> None:
    keep = deblur(capture.blurred, log, CAMERA, EXPOSURE, nsr=0.01)
    flat = deblur(capture.blurred, log, CAMERA, EXPOSURE, nsr=0.01, geometry="rectify")
    assert keep.coverage.all()
    assert not flat.coverage.all()
    assert flat.coverage[40:-40, 40:-40].all()
    # The references differ by the skew (20 dB), so each geometry fits only its own. Resampling a picture with detail
    # down to single pixels costs the rectified one 1 dB.
    own = psnr(capture.rectified, flat.image, border=40)
    assert own > psnr(capture.rectified, keep.image, border=40) + 4
    assert own > psnr(capture.rolling, keep.image, border=40) - 2


@pytest.mark.parametrize(
    ("mode", "direction"), [("banded", "left-right"), ("rowwise", "right-left"), ("banded", "bottom-up")]
)
def test_readout_directions_are_one_problem_turned(capture, log, mode, direction):
    """The same scene stored turned, on a camera described as turned, gives the same result turned."""
    turns = {"left-right": 1, "bottom-up": 2, "right-left": 3}[direction]
    camera = CAMERA
    for _ in range((4 - turns) % 4):
        camera = camera.turned()
    assert camera.readout_direction == direction
    kwargs = {"mode": mode, "bands": 6, "strips": 2, "geometry": "rectify"}
    upright = deblur(capture.blurred, log, CAMERA, EXPOSURE, **kwargs)
    turned = deblur(np.rot90(capture.blurred, turns), log, camera, EXPOSURE, **kwargs)
    # A picture read bottom-up is solved as stored, so the ends of its tiles are elsewhere. The difference is what
    # reaches through margins of 0.6 decay lengths.
    inside = np.s_[32:-32, 32:-32]
    np.testing.assert_allclose(np.rot90(turned.image, -turns)[inside], upright.image[inside], atol=0.02)
    np.testing.assert_array_equal(np.rot90(turned.coverage, -turns), upright.coverage)
    kernels = np.rot90(np.rot90(turned.psfs.kernels, -turns, axes=(0, 1)), -turns, axes=(2, 3))
    np.testing.assert_allclose(kernels, upright.psfs.kernels, atol=1e-6)


@pytest.mark.parametrize("shape", [(), (1,), (2,), (3,), (4,)])
def test_shapes_and_alpha(log: GyroLog, shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(2).random((CAMERA.height, CAMERA.width, *shape), dtype=np.float32)
    result = deblur(picture, log, CAMERA, EXPOSURE, mode="global").image
    assert result.shape == picture.shape
    assert result.dtype == np.float32
    if shape in ((2,), (4,)):
        np.testing.assert_array_equal(result[..., -1], picture[..., -1])
        colour = deblur(picture[..., :-1], log, CAMERA, EXPOSURE, mode="global").image
        np.testing.assert_array_equal(result[..., :-1], colour)


def test_alpha_beyond_its_range_is_clipped_in_integers(log: GyroLog) -> None:
    picture = np.full((CAMERA.height, CAMERA.width, 4), 0.5, np.float32)
    picture[0, :3, 3] = -0.1, 1.2, 1e9
    out = np.empty(picture.shape, np.uint8)
    deblur(picture, log, CAMERA, EXPOSURE, mode="global", out=out)
    assert out[0, :4, 3].tolist() == [0, 255, 255, 128]
    np.testing.assert_array_equal(deblur(picture, log, CAMERA, EXPOSURE, mode="global").image[..., 3], picture[..., 3])
    picture[0, 0, 3] = np.nan
    with pytest.raises(InputError, match="alpha of image must be finite"):
        deblur(picture, log, CAMERA, EXPOSURE, mode="global")


@pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_integers_are_scaled_and_clipped(capture: Simulation, log: GyroLog, dtype: type, top: int) -> None:
    stored = np.round(capture.blurred.clip(0, 1) * top).astype(dtype)
    result = deblur(stored, log, CAMERA, EXPOSURE, transfer="linear").image
    reference = deblur(stored.astype(np.float32) / top, log, CAMERA, EXPOSURE, transfer="linear").image
    assert result.min() >= 0.0
    assert result.max() <= 1.0
    np.testing.assert_allclose(result, reference.clip(0, 1), atol=1e-6)


@pytest.mark.parametrize("transfer", ["srgb", 2.2])
def test_transfer_goes_both_ways(capture: Simulation, transfer: str | float) -> None:
    still = GyroLog([0.0, 0.3], np.zeros((2, 3)))
    picture = capture.rolling.clip(0, 1)
    result = deblur(picture, still, CAMERA, EXPOSURE, transfer=transfer).image
    # Near black the curve is steep: float32 noise of 1e-6 in light is 1e-3 in stored values.
    np.testing.assert_allclose(result, picture, atol=2e-3)


@pytest.fixture(scope="module")
def soft() -> tuple[Simulation, GyroLog]:
    """Simulate a capture with as much detail as photographs have, at 40 dB."""
    log = hand_shake(0.2, strength=0.7, seed=3)
    sharp = ndimage.gaussian_filter(scene(220, 250), (1, 1, 0))
    return simulate(sharp, log, CAMERA, EXPOSURE, noise=0.01), log


def test_auto_is_near_the_best(soft: tuple[Simulation, GyroLog]) -> None:
    capture, log = soft

    def quality(**kwargs: object) -> float:
        return psnr(capture.rolling, deblur(capture.blurred, log, CAMERA, EXPOSURE, chroma="full", **kwargs).image)

    best = {"wiener": max(quality(nsr=nsr) for nsr in (0.01, 0.03, 0.1, 0.3))}
    ladders = {"gradient": (0.01, 0.03, 0.1), "tv": (0.003, 0.01, 0.03), "hyper-laplacian": (0.001, 0.003, 0.01)}
    for prior, weights in ladders.items():
        best[prior] = max(quality(prior=prior, weight=weight) for weight in weights)
    for prior, most in best.items():
        # Measured 0.7, 0.2, 0.3 and 0.7 dB below; flat areas between edges are easier than photographs.
        assert quality(prior=prior) > most - 1.0
    # Measured 32.7, 34.9, 35.9 and 38.5 dB.
    assert best["hyper-laplacian"] > best["gradient"] + 0.3
    assert best["gradient"] > best["wiener"] + 0.3


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("noise", [0.03])
def test_auto_does_a_still_picture_no_harm(soft: tuple[Simulation, GyroLog], prior: str, noise: float) -> None:
    still = GyroLog([0.0, 0.3], np.full((2, 3), 0.02))  # 0.1 px during the exposure
    sharp = soft[0].rolling
    taken = sharp + np.random.default_rng(6).normal(0, noise, sharp.shape).astype(np.float32)
    result = deblur(taken, still, CAMERA, EXPOSURE, prior=prior)
    # To undo 0.1 px raises the noise by 0.02 dB. All priors gain 2 dB.
    assert psnr(sharp, result.image) > psnr(sharp, taken)


def test_strengths_that_are_set_are_used_and_reported(soft: tuple[Simulation, GyroLog]) -> None:
    capture, log = soft
    wiener = deblur(capture.blurred, log, CAMERA, EXPOSURE, nsr=0.07)
    assert (wiener.nsr, wiener.weight) == (0.07, None)
    tv = deblur(capture.blurred, log, CAMERA, EXPOSURE, prior="tv", nsr=0.002, weight=0.03)
    assert (tv.nsr, tv.weight) == (0.002, 0.03)


def test_brightness_is_only_a_factor(soft: tuple[Simulation, GyroLog]) -> None:
    """A darker picture of the same scene gives the same result, darker."""
    capture, log = soft
    grey = capture.blurred[..., 1]
    for prior in ("wiener", "tv", "hyper-laplacian"):
        bright, dark = (deblur(light, log, CAMERA, EXPOSURE, prior=prior).image for light in (grey, grey / 16))
        # Rounding decides which gradients are above the threshold.
        assert np.sqrt(np.mean((16 * dark - bright) ** 2)) < 1e-4


def test_progress_and_timings(capture: Simulation, log: GyroLog) -> None:
    reports: list[tuple[str, float]] = []
    result = deblur(
        *(capture.blurred, log, CAMERA, EXPOSURE),
        geometry="rectify",
        check=True,
        progress=lambda s, f: reports.append((s, f)),
    )
    assert list(result.timings) == ["tune", "psfs", "plan", "apply", "rectify", "check"]
    assert list(dict.fromkeys(stage for stage, _ in reports)) == list(result.timings)
    for stage in result.timings:
        fractions = [f for s, f in reports if s == stage]
        assert fractions == sorted(fractions)
        assert fractions[-1] == 1.0


def seam(image: np.ndarray, bands: int) -> float:
    """Largest mean second difference across a band border, relative to the median of the rows around it."""
    rough = np.abs(np.diff(image, n=2, axis=0)).mean(axis=(1, 2))
    ratios = []
    for border in (np.arange(1, bands) * len(image) / bands - 1).astype(int):
        ratios.append(rough[border - 1 : border + 1].max() / np.median(rough[max(border - 8, 0) : border + 8]))
    return max(ratios)


def test_no_seam_between_bands(log: GyroLog, monkeypatch: pytest.MonkeyPatch) -> None:
    """Band borders are no rougher than the picture itself; an artificial seam is detected."""
    # A smooth picture without noise shows seams best.
    capture = simulate(ndimage.gaussian_filter(scene(220, 250), (6, 6, 0)), log, CAMERA, EXPOSURE)
    own = seam(capture.rolling, 8)
    # Measured 0.99 times the picture's own 1.57.
    assert seam(deblur(capture.blurred, log, CAMERA, EXPOSURE, bands=8).image, 8) < 1.1 * own

    def nearest(centres: np.ndarray, n: int) -> np.ndarray:
        return np.eye(len(centres))[:, np.abs(np.arange(n) - centres[:, None]).argmin(axis=0)]

    monkeypatch.setattr(tiling, "hat_weights", nearest)
    # Measured 4.8 times.
    assert seam(deblur(capture.blurred, log, CAMERA, EXPOSURE, bands=8).image, 8) > 2 * own


# A curved stroke, not symmetric in any way.
KERNEL = np.zeros((9, 11))
KERNEL[[1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 4, 6, 8, 9]] = 1, 1, 2, 3, 3, 2, 1
KERNEL /= KERNEL.sum()


@pytest.fixture(scope="module")
def pictures() -> tuple[np.ndarray, np.ndarray]:
    """Return a sharp picture, and it blurred with noise of 0.01; the blur reads no pixel outside."""
    wide = scene(180, 200)
    blurred = np.stack([ndimage.convolve(plane, KERNEL) for plane in np.moveaxis(wide, -1, 0)], axis=-1)
    noise = np.random.default_rng(0).normal(0, 0.01, blurred.shape)
    inside = np.s_[16:-16, 16:-16]
    return wide[inside], (blurred + noise).astype(np.float32)[inside]


def error(picture: np.ndarray, truth: np.ndarray) -> float:
    inside = np.s_[12:-12, 12:-12]
    return float(np.sqrt(np.mean(np.square((picture - truth)[inside]))))


@pytest.mark.filterwarnings("error")
def test_kernels_with_negative_values_have_strengths(pictures) -> None:
    sharpening = np.array([[0.0, -1, 0], [-1, 5, -1], [0, -1, 0]])
    assert np.isfinite(deconvolve(pictures[1], sharpening).image).all()


@pytest.mark.parametrize("prior", PRIORS)
def test_every_prior_undoes_a_known_blur(pictures: tuple[np.ndarray, np.ndarray], prior: str) -> None:
    sharp, blurred = pictures
    result = deconvolve(blurred, KERNEL, prior=prior)
    # Measured: at most 0.62 of the error of the input; a mirrored kernel doubles the error of the input.
    assert error(result.image, sharp) < 0.75 * error(blurred, sharp)
    assert (result.bands, result.strips, result.check) == (1, 1, None)
    assert result.coverage.all()


def test_it_is_what_deblur_does_with_the_same_psfs() -> None:
    camera, exposure, log = Camera(96, 80, 110.0, readout_time=0.03), Exposure(0.05, 1 / 30), hand_shake(0.2, seed=3)
    blurred = simulate(scene(120, 136), log, camera, exposure).blurred
    for strengths in ({"prior": "wiener", "nsr": 0.02}, {"prior": "tv", "weight": 0.01, "nsr": 0.01}):
        options = {**strengths, "border": "blend"}
        by_motion = deblur(blurred, log, camera, exposure, bands=3, strips=2, **options)
        by_psf = deconvolve(blurred, by_motion.psfs, **options)
        np.testing.assert_array_equal(by_psf.image, by_motion.image)
        assert (by_psf.bands, by_psf.strips) == (3, 2)


def test_automatic_strengths_use_a_given_noise(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    blurred = pictures[1]
    estimated, given, noisy = (deconvolve(blurred, KERNEL, prior="tv", noise=noise) for noise in ("auto", 0.01, 0.05))
    # The estimate is at most twice too high, and the weight grows about like the variance.
    assert 0.007 < estimated.noise < 0.02
    assert (given.noise, noisy.noise) == (0.01, 0.05)
    assert noisy.weight > 3 * given.weight


def test_formats_highlights_and_chunks(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    stored = np.rint(255 * pictures[1].clip(0, 1)).astype(np.uint8)
    stored[60:64, 60:64] = 255
    out = np.empty_like(stored)
    # The values stored are linear light.
    settings = {"prior": "wiener", "nsr": 0.01, "transfer": "linear"}
    whole = deconvolve(stored, KERNEL, saturation="always", out=out, **settings)
    assert whole.image is out
    assert "highlights" in whole.timings
    bank = PsfBank.for_picture(np.broadcast_to(KERNEL, (3, 2, *KERNEL.shape)), stored.shape)
    tiled = deconvolve(stored, bank, max_memory=55 << 20, **settings)
    one = deconvolve(stored, KERNEL, saturation="ignore", **settings)
    # Equal PSFs everywhere; tiles and chunks ring a little at their ends (measured 0.012).
    assert error(tiled.image, one.image) < 0.02
    grey = deconvolve(pictures[1][..., 0], KERNEL, prior="wiener", nsr=0.01, border="periodic").image
    assert grey.shape == pictures[1].shape[:2]


def test_what_speaks_against_kernel_and_encoding_is_said(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    """Nothing is said of the right ones; a wrong encoding, half a turn and a floor are named, and `check` ends that."""
    blurred = pictures[1].clip(0, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        right = deconvolve(blurred, KERNEL, transfer="linear")
        unchecked = deconvolve(blurred, KERNEL[::-1, ::-1], transfer="linear", check=False)
    assert right.check is unchecked.check is None
    for words, kernel, transfer in (
        ("transfer linear", KERNEL, "srgb"),
        ("turned", KERNEL[::-1, ::-1], "linear"),
        ("0.6 times as large", PsfBank.for_picture(KERNEL, blurred.shape).scaled(1 / 0.6), "linear"),
        ("rim", KERNEL + 0.01, "linear"),
        ("inverted", KERNEL.max() - KERNEL, "linear"),
    ):
        with pytest.warns(RsdeblurWarning, match=words):
            deconvolve(blurred, kernel, transfer=transfer)


@pytest.mark.parametrize("kernels", [PsfBank.parametric(line=(5, 30)), np.full((2, 2, 1, 3), 1 / 3)])
@pytest.mark.filterwarnings("ignore:the PSF fits the picture better")  # it is sharp
def test_places_beyond_the_middle_are_no_hindrance(kernels: PsfBank | np.ndarray) -> None:
    """The check solves the middle 320 px."""
    sharp = scene(500, 500)[..., 0]
    assert deconvolve(sharp, kernels, transfer="linear").image.shape == sharp.shape


def test_sums_and_even_sizes_of_kernels_do_not_matter(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    whole = deconvolve(pictures[1], KERNEL, transfer="linear", check=False).image
    scaled = deconvolve(pictures[1], 3 * KERNEL[:, :-1], transfer="linear", check=False).image
    # Rounding of the kernel.
    np.testing.assert_allclose(scaled, whole, atol=1e-5)
