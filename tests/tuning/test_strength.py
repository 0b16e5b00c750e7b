"""Strengths of the priors: against pictures whose spectrum and noise are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import fft

from benchmarks.phone import phone_photo
from rsdeblur import Deconvolver, PsfBank, scene, to_linear
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.motion import BlurPaths
from rsdeblur.tuning import Tuning
from rsdeblur.tuning import strength as tuning
from rsdeblur.tuning.noise import measure_floors

SIDE = 256


def kernel(size: tuple[int, int] = (9, 15), seed: int = 1) -> np.ndarray:
    values = np.random.default_rng(seed).random(size).astype(np.float32) ** 8
    return values / values.sum()


@pytest.fixture(autouse=True)
def no_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rsdeblur.tuning.strength.LENS", 0.0)


@pytest.fixture
def as_modelled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set all corrections to zero: the pictures and blurs of these tests follow the equations exactly."""
    monkeypatch.setattr(tuning, "FINE_NOISE", 1.0)
    monkeypatch.setattr(tuning, "ABSORBED", 0.0)


@pytest.fixture(scope="module")
def sharp() -> np.ndarray:
    """A picture whose gradient has an even spectrum of energy 0.01."""
    white = np.random.default_rng(2).normal(0.0, 0.1, (SIDE, SIDE))
    y, x = fft.fftfreq(SIDE)[:, None], fft.fftfreq(SIDE)
    differences = np.sqrt(4 * np.sin(np.pi * y) ** 2 + 4 * np.sin(np.pi * x) ** 2)
    differences[0, 0] = np.inf
    return fft.ifft2(fft.fft2(white) / differences).real[:, :, None].astype(np.float32) + 0.5


def blurred(sharp: np.ndarray, psf: np.ndarray, noise: float) -> np.ndarray:
    placed = np.zeros((SIDE, SIDE))
    placed[: psf.shape[0], : psf.shape[1]] = psf
    placed = np.roll(placed, (-(psf.shape[0] // 2), -(psf.shape[1] // 2)), axis=(0, 1))
    clean = fft.ifft2(fft.fft2(sharp[..., 0]) * fft.fft2(placed)).real
    return (clean + np.random.default_rng(3).normal(0.0, noise, clean.shape)).astype(np.float32)[:, :, None]


@pytest.mark.parametrize("size", [(3, 3), (9, 15), (1, 41)])
def test_energy_of_the_sharp_picture_is_found(sharp: np.ndarray, size: tuple[int, int]) -> None:
    psf = np.full(size, 1 / np.prod(size), dtype=np.float32)
    bank = PsfBank.for_picture(psf, sharp.shape)
    tuned = Tuning.of(blurred(sharp, psf, 0.003), bank)
    # The gradient across 128 x 128 differences of half the size, some of them alike: a few per cent by chance.
    assert tuned.energy == pytest.approx(0.01, rel=0.15)


@pytest.mark.usefixtures("as_modelled")
@pytest.mark.parametrize("noise", [0.01, 0.03])
@pytest.mark.parametrize("name", ["wiener_nsr", "gradient_weight"])
def test_strengths_are_the_best_ones(sharp: np.ndarray, noise: float, name: str) -> None:
    bank = PsfBank.for_picture(kernel(), sharp.shape)
    picture = blurred(sharp, kernel(), noise)

    def error(value: float) -> float:
        if name == "wiener_nsr":
            result = Deconvolver(bank, picture.shape, nsr=value, border="periodic").apply(picture)
        else:
            tiles = TileQuadratic(bank, picture.shape, nsr=1e-6, border="periodic")
            result = tiles.apply(picture, prior=DerivativePrior("gradient", value))
        return float(np.sqrt(np.mean((result - sharp) ** 2)))

    best = getattr(Tuning.of(picture, bank), name)
    assert error(best) < 1.02 * min(error(value) for value in np.geomspace(1e-3, 3, 15))


@pytest.mark.usefixtures("as_modelled")
def test_one_filter_for_other_psfs_is_regularised_for_them(sharp: np.ndarray) -> None:
    kernels = np.stack([kernel(seed=seed) for seed in (1, 2, 3)])[:, None]
    bank = PsfBank.for_picture(kernels, sharp.shape)
    # The top and the bottom third are blurred by PSFs that the filter does not know.
    parts = np.array_split(np.arange(SIDE), 3)
    picture = np.concatenate([blurred(sharp, k[0], 0.003)[rows] for k, rows in zip(kernels, parts, strict=True)])

    def error(nsr: float) -> float:
        middle = PsfBank.for_picture(kernels[1], sharp.shape)
        result = Deconvolver(middle, picture.shape, nsr=nsr, border="periodic").apply(picture)
        return float(np.sqrt(np.mean((result - sharp) ** 2)))

    each, one = Tuning.of(picture, bank), Tuning.of(picture, bank, one_filter=True)
    assert one.gradient_weight > each.gradient_weight
    assert error(one.wiener_nsr) < 1.05 * min(error(nsr) for nsr in np.geomspace(1e-3, 3, 15))
    assert error(one.wiener_nsr) < error(each.wiener_nsr)


def test_unknown_rows_leave_the_sideways_share_of_the_border(sharp: np.ndarray) -> None:
    psf = np.full((91, 9), 1 / 819, dtype=np.float32)
    picture, bank = blurred(sharp, psf, 0.003), PsfBank.for_picture(psf, sharp.shape)
    assert Tuning.of(picture, bank).border_error == pytest.approx((91 / SIDE) ** 2 / 4)
    assert Tuning.of(picture, bank, continued=False).border_error == pytest.approx((9 / SIDE) ** 2 / 4)


@pytest.mark.parametrize("size", [3, 21])
def test_processing_is_no_large_error_of_a_small_motion(size: int) -> None:
    """What a phone's denoising and sharpening leave looks like a path that errs by more than small motion can."""
    photo = phone_photo(scene(256, 384), 0)
    light = to_linear(photo.astype(np.float32) / np.float32(255), "srgb")
    bank = PsfBank.for_picture(np.full((1, size), 1 / size, np.float32), light.shape)
    tuned, measured = Tuning.of(light, bank), measure_floors(light, bank)
    assert measured is not None
    bound = max(0.25 * tuned.radius, 0.15) ** 2
    error = tuning.ABSORBED_BY_EXACT**2 * measured.path_error
    assert tuned.path_error == min(error, bound)
    # Measured: 0.25 px where 3 px of motion allow 0.20, and 0.13 where 21 px allow 1.5.
    assert (error > bound) == (size == 3)


@pytest.mark.parametrize("length", [0.0, 0.2, 4.0])
def test_a_path_errs_by_no_more_than_half_of_its_spread(length: float) -> None:
    """Where nothing moves, there is nothing to undo: the photo's texture is no error of the motion."""
    light = to_linear(phone_photo(scene(256, 384), 0).astype(np.float32) / np.float32(255), "srgb")
    path = np.zeros((1, 1, 65, 2))
    path[..., 0] = length * np.linspace(-0.5, 0.5, 65)
    bank = PsfBank.from_paths(BlurPaths(path, np.array([127.5]), np.array([191.5])))
    tuned = Tuning.of(light, bank)
    spread = np.sqrt((path**2).sum(axis=3).mean())
    # Drawing widens PSFs, so that a quarter of their radius may be the larger bound.
    assert tuned.path_error <= max(0.25 * tuned.radius, min(0.15, 0.5 * spread)) ** 2 * (1 + 1e-9)
    if not length:
        assert tuned.path_error == 0.0


def test_strengths_follow_the_noise_and_the_blur(sharp: np.ndarray) -> None:
    def tune(noise: float, size: tuple[int, int]) -> Tuning:
        psf = np.full(size, 1 / np.prod(size), dtype=np.float32)
        return Tuning.of(blurred(sharp, psf, noise), PsfBank.for_picture(psf, sharp.shape))

    quiet, noisy, long = tune(0.003, (3, 9)), tune(0.03, (3, 9)), tune(0.003, (3, 91))
    for prior in ("gradient", "tv", "hyper-laplacian"):
        assert noisy.weight(prior, 0.5) > 2 * quiet.weight(prior, 0.5)
        assert long.weight(prior, 0.5) > quiet.weight(prior, 0.5)
    assert noisy.wiener_nsr > quiet.wiener_nsr
    assert long.border_error > quiet.border_error
    assert quiet.radius == pytest.approx(np.sqrt((9**2 - 1 + 3**2 - 1) / 12), rel=1e-5)


def test_weights_scale_with_brightness(sharp: np.ndarray) -> None:
    bank = PsfBank.for_picture(kernel(), sharp.shape)
    picture = blurred(sharp, kernel(), 0.01)
    one, four = Tuning.of(picture, bank), Tuning.of(4 * picture, bank)
    for prior, exponent in (("gradient", 2.0), ("tv", 1.0), ("hyper-laplacian", 0.5)):
        # |A u - g|^2 grows by 16, the penalty by 4^p.
        assert four.weight(prior, exponent) == pytest.approx(
            4 ** (2 - exponent) * one.weight(prior, exponent), rel=1e-3
        )
    assert four.wiener_nsr == one.wiener_nsr


@pytest.mark.parametrize("level", [0.0, 0.7])
def test_an_even_picture_gets_numbers(level: float) -> None:
    tuned = Tuning.of(np.full((40, 50, 3), level, dtype=np.float32), PsfBank.for_picture(kernel(), (40, 50, 3)))
    strengths = [tuned.wiener_nsr, tuned.gradient_nsr, *(tuned.weight(p, 0.5) for p in ("gradient", "tv"))]
    assert np.isfinite(strengths).all()
    assert min(strengths) > 0


def test_sparse_weights_of_one_channel_are_smaller(sharp: np.ndarray) -> None:
    bank = PsfBank.for_picture(kernel(), sharp.shape)
    one = Tuning.of(blurred(sharp, kernel(), 0.01)[..., 0], bank)
    three = replace(one, channels=3)
    assert one.channels == 1
    assert one.weight("gradient", 1.0) == three.weight("gradient", 1.0)
    for prior in ("tv", "hyper-laplacian"):
        assert one.weight(prior, 0.7) == pytest.approx(tuning.GREY_STRENGTH * three.weight(prior, 0.7))


def test_a_grey_picture_is_one_channel(sharp: np.ndarray) -> None:
    picture = blurred(sharp, kernel(), 0.01)
    bank = PsfBank.for_picture(kernel(), sharp.shape)
    flat, deep = Tuning.of(picture[..., 0], bank), Tuning.of(picture, bank)
    assert (flat.noise, flat.energy, flat.wiener_nsr) == (deep.noise, deep.energy, deep.wiener_nsr)
