"""Several frames of one scene deblurred together."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Deconvolver, Exposure, InputError, PsfBank, deblur, deblur_burst, hand_shake
from rsdeblur.burst import BurstResult
from rsdeblur.burst.alignment import combined, path_error_share, restoration_error, with_path_errors
from rsdeblur.deconv import DerivativePrior, RowDeconvolver, TileQuadratic
from rsdeblur.deconv.priors import LatentPrior
from rsdeblur.deconv.quadratic import TileNormal
from rsdeblur.deconv.rowwise import RowSolver
from rsdeblur.estimate import Refinement
from rsdeblur.estimate.correction import Correction
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.motion.paths import burst_captures
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.simulate import simulate_clip
from rsdeblur.tuning import Tuning

CAMERA = Camera(160, 128, 180.0, readout_time=0.02)
EXPOSURES = [Exposure(0.1, 1 / 20), Exposure(0.2, 1 / 25), Exposure(0.3, 1 / 20)]
LOG = hand_shake(0.5, seed=4)
INNER = np.s_[16:-16, 16:-16]
PLAIN = np.zeros((128, 160, 3), np.float32)


@cache
def frames(noise: float = 0.01) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the blurred frames and the sharp ones, in linear light."""
    capture = scene(176, 208), LOG, CAMERA, EXPOSURES
    return list(simulate_clip(*capture, noise=noise, samples=32)), list(simulate_clip(*capture, samples=1))


def error(result: np.ndarray, truth: np.ndarray) -> float:
    return float(np.square(result - truth)[INNER].mean())


@cache
def alone(index: int) -> float:
    blurred, sharp = frames()
    result = deblur(blurred[index], LOG, CAMERA, EXPOSURES[index], prior="wiener", check=False)
    return error(result.image, sharp[index])


def together(images=None, **options) -> BurstResult:
    images = frames()[0] if images is None else images
    return deblur_burst(images, LOG, CAMERA, EXPOSURES, **{"prior": "wiener", "check": False} | options)


@cache
def in_tiles(bands: int | str = "auto") -> BurstResult:
    """Return the result of all frames with the first one as the reference."""
    return together(reference=0, bands=bands, check=bands == 2)


@pytest.mark.parametrize("light", [0.0, 1.0])
def test_a_frame_that_shows_nothing_is_no_reference(light: float) -> None:
    images = list(frames()[0])
    images[1] = np.full_like(images[1], light)
    result = together(images)
    assert result.reference != 1
    assert result.frames[1].share < 0.01
    assert result.result.image.std() > 0.5 * images[0].std()


def test_the_result_does_not_overwrite_a_frame() -> None:
    images = [np.float32(image) for image in frames()[0]]
    for image in images:
        with pytest.raises(InputError, match="out must not overlap"):
            together(images, out=image)


def test_frames_together_are_sharper_than_the_best_alone() -> None:
    result = together()
    best = min(alone(n) for n in range(3))
    assert error(result.image, frames()[1][result.reference]) < 0.8 * best
    assert sum(frame.share for frame in result.frames) == pytest.approx(1)
    assert all(frame.support > 0.9 and abs(frame.gain - 1) < 0.01 and frame.shift < 0.3 for frame in result.frames)


def test_softness_of_the_lens_is_undone() -> None:
    blurred, sharp = frames(noise=0.002)
    soft = [gaussian_filter(image, (0.8, 0.8, 0)) for image in blurred]
    plain, undone = (together(soft, mode="rowwise", reference=0, softness=softness) for softness in (0.0, 0.8))
    # Measured 0.51 times.
    assert error(undone.image, sharp[0]) < 0.8 * error(plain.image, sharp[0])
    assert "\n" not in repr(undone)


def test_tall_blur_that_changes_is_solved_row_by_row() -> None:
    """Four times the shake makes tiles wrong by up to 0.6 px, where 0.3 px are allowed; the other log by 0.04 px."""
    capture = scene(176, 208), hand_shake(0.5, seed=4, strength=4.0), CAMERA, EXPOSURES[:2]
    images = list(simulate_clip(*capture, samples=32))

    def mode(log=capture[1], **options) -> str:
        return deblur_burst(images, log, CAMERA, EXPOSURES[:2], prior="wiener", check=False, **options).result.mode

    assert mode() == "rowwise"
    assert mode(log=LOG) == "banded"
    # What is given explicitly is kept.
    assert mode(mode="banded") == mode(bands=4) == "banded"


def test_order_and_brightness_of_frames_do_not_matter() -> None:
    images = frames()[0]
    separate = in_tiles()
    expected = separate.image
    mixed = deblur_burst(
        [images[2] * np.float32(0.5), images[0], images[1]],
        *(LOG, CAMERA, [EXPOSURES[n] for n in (2, 0, 1)]),
        reference=1,
        prior="wiener",
        check=False,
    )
    assert mixed.frames[0].gain == pytest.approx(0.5, rel=0.01)
    # Half the light with half the noise counts as much.
    assert mixed.frames[0].share == pytest.approx(separate.frames[2].share, rel=0.02)
    # The gain is estimated from noisy pictures; other rounding may change an iteration of the fit.
    assert np.abs(mixed.image - expected)[INNER].max() < 0.03
    assert np.sqrt(np.square(mixed.image - expected)[INNER].mean()) < 0.003


def test_a_frame_of_another_scene_is_left_out() -> None:
    images = list(frames()[0])
    images[2] = images[2][::-1, ::-1].copy()
    result = together(images, reference=0)
    assert result.frames[2].share == 0
    assert result.frames[2].support < 0.5
    assert error(result.image, frames()[1][0]) < alone(0)
    # With the odd frame as the first candidate, the others still find each other.
    assert together(images).reference != 2


def test_a_moving_thing_counts_where_it_is_not() -> None:
    images = [image.copy() for image in frames()[0]]
    images[1][40:80, 60:110] = 0.9
    result = together(images, reference=0)
    weights = result.frames[1].weights
    assert weights[60, 85] == 0
    assert np.mean(weights == 1) > 0.2
    assert error(result.image, frames()[1][0]) < 1.05 * alone(0)


def test_where_only_the_reference_shows_the_scene_the_result_has_its_prior() -> None:
    blurred, sharp = frames()
    images, area = [image.copy() for image in blurred[:2]], np.s_[45:75, 65:105]
    images[1][40:80, 60:110] = 0.9
    single = deblur(images[0], LOG, CAMERA, EXPOSURES[0], prior="tv", check=False).image
    both = deblur_burst(images, LOG, CAMERA, EXPOSURES[:2], reference=0, prior="tv", check=False).image
    errors = [float(np.square(result - sharp[0])[area].mean()) for result in (both, single)]
    # Measured 0.97 times; 1.11 times if the Wiener filter predicts what the other frame does not show.
    assert errors[0] < 1.03 * errors[1]


def test_shares_fall_with_noise_and_blur() -> None:
    light = frames()[0][0]
    bank = PsfBank.for_picture(np.full((1, 9), 1 / 9), light.shape)
    tuning = Tuning.of(light, bank, noise=0.01)
    double, shares = combined([tuning, tuning])
    # The second one is resampled, which is an error that the first one does not have.
    assert 0.5 < shares[0] < 0.6
    # Two frames are one with half the variance if their shares are equal.
    assert double.noise == pytest.approx(0.01 * np.hypot(*shares))
    assert double.gradient_weight <= tuning.gradient_weight
    _, shares = combined([tuning, replace(tuning, octave_noise=(0.03,) * 3), with_path_errors(tuning, 0.5)])
    assert shares[0] > max(shares[1:])
    assert restoration_error(tuning, 1.0) < restoration_error(replace(tuning, octave_noise=(0.1,) * 3), 1.0)
    # Errors that tiles add to a frame are its noise, but not that of the whole burst.
    worse, shares = combined([tuning, tuning], tile_errors=[0.0, 0.5])
    assert shares[0] > shares[1]
    assert worse.path_error > double.path_error


def test_errors_of_paths_are_measured() -> None:
    light = frames()[0][0]
    tuning = Tuning.of(light, PsfBank.for_picture(np.full((1, 9), 1 / 9), light.shape), noise=0.01)
    other = replace(tuning, radius=2 * tuning.radius)
    known = tuning.path_error + other.path_error
    further = (0.1 * tuning.radius) ** 2 + (0.1 * other.radius) ** 2
    share = path_error_share(tuning, other, known + further)
    assert share == pytest.approx(0.1)
    assert path_error_share(tuning, other, 0.5 * known) == 0
    errors = [with_path_errors(frame, share).path_error for frame in (tuning, other)]
    assert sum(errors) == pytest.approx(known + further)


def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """So small a picture is solved in chunks only if they read few rows more and fixed buffers do not count."""
    monkeypatch.setattr("rsdeblur.pipeline.memory._reach", lambda *_: 24)
    monkeypatch.setattr("rsdeblur.pipeline.memory.FIXED", 0)


def test_rowwise_is_as_good_and_chunks_give_the_same_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = frames()[1][0]
    result = together(reference=0, mode="rowwise")
    whole = result.image
    assert result.result.bands == len(whole)
    assert error(whole, truth) < 1.1 * error(in_tiles().image, truth)
    small_chunks(monkeypatch)
    chunks = together(reference=0, mode="rowwise", max_memory=5_000_000).image
    assert 0 < np.abs(chunks - whole)[INNER].max() < 0.02


def test_the_default_bound_grows_instead_of_refusing(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = in_tiles(2).image
    monkeypatch.setattr("rsdeblur.burst.solution.MEMORY", 1)
    # Strengths are the same; tiles end elsewhere.
    assert np.abs(together(reference=0, bands=2).image - expected)[INNER].max() < 0.02
    with pytest.raises(InputError, match="max_memory is 0 MiB, but even 16 rows of 3 frames need"):
        together(reference=0, bands=2, max_memory=1)


def test_chunks_give_the_same_picture_and_the_check_judges_it(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = in_tiles(2)
    small_chunks(monkeypatch)
    chunks = together(reference=0, bands=2, max_memory=3_500_000, check=True)
    # Strengths are the same; tiles end elsewhere.
    assert 0 < np.abs(chunks.image - whole.image)[INNER].max() < 0.02
    assert whole.result.check is not None
    assert chunks.result.check is not None
    assert chunks.result.check.verdict == whole.result.check.verdict


def test_horizontal_readout_and_rectify() -> None:
    images = [np.rot90(image, -1) for image in frames()[0]]
    camera = replace(CAMERA.turned(), readout_direction="right-left")
    result = deblur_burst(images, LOG, camera, EXPOSURES, prior="wiener", geometry="rectify", check=False)
    assert result.image.shape == (160, 128, 3)
    assert result.frames[0].weights.shape == (160, 128)


@pytest.mark.parametrize(
    "options",
    [
        {"border": "periodic"},
        {"border": "periodic", "prior": "tv", "weight": 0.01},
        {"prior": "hyper-laplacian", "weight": 0.01, "exponent": 0.5},
        {"motion": "small-angle"},
        {"motion": "small-angle", "mode": "rowwise"},
        {"saturation": "always"},
    ],
    ids=lambda options: " ".join(map(str, options.values())),
)
def test_a_frame_taken_twice_is_that_frame_alone(options: dict) -> None:
    """The normal equations of equal frames are those of one frame, whatever the options."""
    image, exposure = np.minimum(2.5 * frames()[0][0], 1), EXPOSURES[0]
    options = {"prior": "wiener", "mode": "banded", "nsr": 0.01, "check": False, "bands": 4, "strips": 2} | options
    # By default, a burst takes all small spots or none.
    options = {"saturation": "ignore"} | options
    one = deblur(image, LOG, CAMERA, exposure, chroma="full", **options).image
    two = deblur_burst([image, image], LOG, CAMERA, [exposure, exposure], **options).image
    # The second frame is resampled at its own pixels, up to rounding: 2e-6 root mean square. The shrinkage of a
    # non-convex prior jumps, so that rounding changes single pixels by up to 2e-3 there: 1.5e-5 root mean square.
    # Rowwise traces every fourth row of each frame.
    assert np.square(two - one).mean() ** 0.5 < (1e-3 if options["mode"] == "rowwise" else 1e-4)
    np.testing.assert_allclose(two, one, atol=5e-3 if "exponent" in options or options["mode"] == "rowwise" else 2e-4)


def test_clipped_highlights_are_separated_in_every_frame() -> None:
    blurred, sharp = (
        [image + 30 * spots for image, spots in zip(pictures, bright, strict=True)]
        for pictures, bright in zip(frames(0.002), lamps(), strict=True)
    )
    clipped = [image.clip(0, 1) for image in blurred]
    ignored, separated = (
        together(clipped, reference=0, saturation=saturation).image.clip(0, 1) for saturation in ("ignore", "always")
    )
    # Measured 0.4 times.
    assert error(separated, sharp[0].clip(0, 1)) < 0.7 * error(ignored, sharp[0].clip(0, 1))


@cache
def lamps() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return a few lamps on black, blurred and sharp, for each frame."""
    picture = np.zeros((176, 208, 3), np.float32)
    for row, col in ((60, 70), (90, 140), (120, 60)):
        picture[row : row + 2, col : col + 2] = 1.0
    capture = picture, LOG, CAMERA, EXPOSURES
    return list(simulate_clip(*capture, samples=32)), list(simulate_clip(*capture, samples=1))


def test_refine_corrects_the_recording_by_the_most_blurred_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    images, asked = frames()[0], []
    wrong = replace(CAMERA, time_offset=0.01)

    def refined(images, log, camera, exposures, **_: object) -> list[Refinement]:
        asked.append((len(images), exposures))
        nothing = Correction()
        return [Refinement(log, CAMERA, each, None, True, "", nothing, nothing, 0.9, 9.0, 0.1) for each in exposures]

    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", refined)
    monkeypatch.setattr("rsdeblur.burst.burst.REFINED_FRAMES", 2)
    result = deblur_burst(images, LOG, wrong, EXPOSURES, prior="wiener", check=False, refine=True)
    assert result.result.refinement is not None
    assert result.result.refinement.accepted
    np.testing.assert_array_equal(result.image, together().image)
    lengths = [Capture.from_log(LOG, wrong, exposure).probe.lengths.mean() for exposure in EXPOSURES]
    least = int(np.argmin(lengths))
    assert asked == [(2, [exposure for n, exposure in enumerate(EXPOSURES) if n != least])]


SOLVED = 96, 112, 3
ENGINE: dict[str, Any] = {"nsr": 0.01, "reach": 0, "border": "blend", "threads": None}
TV = DerivativePrior("tv", 2e-3)


def bar(down: int, across: int) -> PsfBank:
    """Bars of one length, upright in the upper half of the picture and flat in the lower half."""
    kernels = np.zeros((2, 1, 9, 9))
    kernels[0, 0, 4 - down : 5 + down, 4] = 1 / (2 * down + 1)
    kernels[1, 0, 4, 4 - across : 5 + across] = 1 / (2 * across + 1)
    return PsfBank.for_picture(kernels, SOLVED)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return scene(*SOLVED[:2]).astype(np.float32)


@pytest.mark.parametrize("wiener", [True, False])
def test_equal_frames_are_one_picture(picture: np.ndarray, wiener: bool) -> None:
    bank = bar(3, 4)
    burst = TileNormal([bank, bank], [0.3, 0.7], SOLVED, nsr=0.01, wiener=wiener, border="blend", threads=None)
    got = burst.combine([picture, picture], prior=None if wiener else TV)
    if wiener:
        expected = Deconvolver(bank, SOLVED, nsr=0.01).apply(picture)
    else:
        expected = TileQuadratic(bank, SOLVED, nsr=0.01).apply(picture, prior=TV)
    # float32, and the order of a few operations.
    np.testing.assert_allclose(got, expected, atol=2e-5)


@pytest.fixture(scope="module")
def paths() -> list[BlurPaths]:
    """Paths of every row of two frames, bent differently."""
    log, camera = hand_shake(0.5, seed=4), Camera(112, 96, 130.0, readout_time=0.02)
    captures = burst_captures(log, camera, [Exposure(0.1, 1 / 20), Exposure(0.2, 1 / 25)])
    rows, cols = np.arange(96.0), np.array([27.0, 83.0])
    return [BlurPaths.from_capture(capture, rows, cols, reference=captures[0]) for capture in captures]


@pytest.mark.parametrize("prior", [None, DerivativePrior("gradient", 1e-2)], ids=["wiener", "gradient"])
def test_rowwise_frames_add_up(picture: np.ndarray, paths: list[BlurPaths], prior: LatentPrior) -> None:
    single = RowDeconvolver(paths[0], SOLVED).apply(picture, prior=prior)
    # float32.
    twice = RowSolver([paths[0], paths[0]], [0.25, 0.75], SOLVED, **ENGINE).combine([picture, picture], prior=prior)
    np.testing.assert_allclose(twice, single, atol=2e-4)


def test_what_the_steps_keep_changes_nothing(picture, paths, monkeypatch):
    """Where there is no room for the normal matrices, they are computed anew in every step."""
    solver = RowSolver(paths, [0.5, 0.5], SOLVED, **ENGINE)
    kept = solver.combine([picture, picture], prior=TV)
    for room in (0, 4 * solver._assembled_sizes[0]):
        monkeypatch.setattr("rsdeblur.deconv.rowwise.ASSEMBLED_BYTES", room)
        # Sums are taken in another order.
        np.testing.assert_allclose(solver.combine([picture, picture], prior=TV), kept, atol=2e-5)
