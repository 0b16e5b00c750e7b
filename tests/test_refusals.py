"""Every public function refuses what is no argument, or out of range, in one short message that names it.

What files contain is in `io/test_unreadable.py`.
"""

import math
import re
from collections.abc import Callable
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsdeblur as rs
from rsdeblur import Camera, CoverageError, Exposure, GyroLog, InputError, Options, PsfBank, Translation, deconv
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.io import Picture
from rsdeblur.motion import AccelerationLog, BlurPaths, Capture, Trajectory
from rsdeblur.motion.paths import burst_captures
from rsdeblur.report import psf_map, side_by_side

HEIGHT, WIDTH = SHAPE = 36, 48
LOG, CAMERA, EXPOSURE = rs.hand_shake(0.2, strength=1.0, seed=3), Camera(WIDTH, HEIGHT, 60.0), Exposure(0.05, 0.025)
IMAGE = np.random.default_rng(0).random((*SHAPE, 3), dtype=np.float32)
PLAIN, GREY = IMAGE[..., 0], IMAGE[..., 0].astype(np.float64)
KERNEL, POINT = np.full((1, 5), 0.2), np.ones((1, 1))
BANK = PsfBank.for_picture(KERNEL, SHAPE)
PATHS, PRIOR = BlurPaths(np.full((HEIGHT, 1, 2, 2), 0.5), np.arange(HEIGHT), [20.0]), DerivativePrior("tv", 0.01)
TRAJECTORY = Trajectory([0, 1], [[0, 0, 0], [1, 0, 0]], [[0, 0, 0, 1]] * 2)
PIXELS = np.zeros((4, 4), np.uint8)
T = np.linspace(0.0, 1.0, 11)
STILL, NOWHERE = GyroLog(T, np.zeros((11, 3))), np.zeros((2, 3))
POSES = np.tile([0.0, 0.0, 0.0, 1.0], (11, 1))
SIGNALLING = [
    np.full((9, 9), bits, f"u{size}").view(f"f{size}")
    for size, bits in ((2, 0x7C01), (4, 0x7F800001), (8, 0x7FF0000000000001))
]
FISHEYE: dict[str, Any] = {"distortion_model": "fisheye", "distortion": (0.0,) * 4}
# No message is longer.
LONGEST = 400
Call = Callable[[], Any]
Door = Callable[[Any], Any]


# Planned when a test wants them: to collect tests must not wait for kernels to be compiled.
blur = cache(lambda: deconv.RowBlur(PATHS, WIDTH))
wiener = cache(lambda: rs.Deconvolver(BANK, SHAPE))
tiles = cache(lambda: TileQuadratic(BANK, SHAPE))
rows = cache(lambda: deconv.RowDeconvolver(PATHS, SHAPE))
plan = cache(lambda: rs.plan(LOG, CAMERA, EXPOSURE))


def deblur(image: Any = IMAGE, camera: Any = CAMERA, **options: Any) -> Call:
    return lambda: rs.deblur(image, LOG, camera, EXPOSURE, **options)


def camera(**changes: Any) -> Call:
    return lambda: Camera(**({"width": 64, "height": 48, "focal_length": 80.0} | changes))


def log(t: Any, omega: Any, epoch: Any = 0) -> Call:
    return lambda: GyroLog(t, omega, epoch)


def spoilt(value: float) -> np.ndarray[Any, Any]:
    """Return a picture with one wrong pixel."""
    image = GREY.copy()
    image[7, 9] = value
    return image


def longest(reach: float) -> BlurPaths:
    return BlurPaths(np.array([[0.0, 0.0], [reach, reach]]) * np.ones((HEIGHT, 1, 1, 1)), np.arange(HEIGHT), [20.0])


def turning(rate: float) -> GyroLog:
    return GyroLog(np.arange(200) * 0.005, np.full((200, 3), [0.0, rate, 0.0]))


def impulses(step: float, side: int) -> PsfBank:
    kernels, centres = np.zeros((1, 1, 3, 3), np.float32), np.arange(4.0, side, step)
    kernels[..., 1, 1] = 1
    return PsfBank(np.broadcast_to(kernels, (len(centres), len(centres), 3, 3)), centres, centres)


# Options that contradict each other, or are out of range.
OPTIONS: list[tuple[dict[str, Any], str]] = [
    *(({"border": "unknown", name: value}, f"the {name} {value}") for name, value in (
        ("mode", "rowwise"), ("prior", "wiener"), ("quality", "best"))),
    ({"fallback": True, "geometry": "rectify"}, "shape"),
    *(({"max_memory": 2**30, name: value}, f"{name}.* the whole picture") for name, value in (
        ("normalize", True), ("border", "unknown"), ("geometry", "rectify"), ("saturation", "always"))),
    *(({"normalize": "yes"}, "normalize"), ({"max_memory": 0.5}, "max_memory"), ({"softness": 1.5}, "softness")),
    *(({"exponent": 0}, "exponent"), ({"prior": "tv", "exponent": 0.5}, "exponent")),
    *(({"quality": "fast", "weight": 0.1}, "weight"), ({"chroma": "half", "prior": "cnn"}, "half colours")),
    ({"chroma": "half", "border": "unknown"}, "half colours"),
    *(({name: value}, f"^{name} must be") for name in ("nsr", "weight") for value in (
        0.0, 1e-21, 1e21, math.inf, math.nan)),
    *(({"noise": value}, "^noise must be") for value in (-1e-9, 2e12, math.nan)),
    *(({"transfer": value}, "^transfer must be") for value in (0.0, 0.09, 11.0, -2.2, math.nan, "sRGB")),
]  # fmt: skip
PICTURES: list[tuple[str, Call]] = [
    *((f"^{name} must be at most", deblur(**{name: value})) for name, value in (
        ("bands", HEIGHT + 1), ("bands", 10**5000), ("strips", WIDTH + 1), ("threads", 10**6))),
    ("^strips must be at most", deblur(strips=10**6, mode="rowwise")),
    *(("^image must", deblur(spoilt(value), **options)) for value in (-2e12, 1e300, math.nan, math.inf) for options in (
        {}, {"weight": 0.01}, {"prior": "wiener", "nsr": 0.01}, {"mode": "rowwise"})),
    ("change the camera as the picture was", deblur(GREY.T)),
    (r"--size .*camera.resized", deblur(GREY[::2, ::2])),
    ("--crop .*cropped", deblur(GREY[:30, :30])),
    ("C from 1 to 4", deblur(np.zeros((*SHAPE, 5)))),
    ("image must have shape", deblur(np.zeros(7))),
    *(("image must be .*" + str(np.dtype(kind)), deblur(GREY.astype(kind))) for kind in (np.int32, complex)),
    ("most of them beyond 1", deblur(IMAGE * np.float32(65535), out=np.empty_like(IMAGE, dtype=np.uint8))),
    *(("image must be an array", deblur(path)) for path in ("photo.png", Path("photo.png"))),
    ("pass its .pixels", deblur(Picture(np.zeros(SHAPE, np.uint8)))),
    ("pass its .pixels", lambda: wiener().apply(Picture(np.zeros(SHAPE, np.uint8)))),
    ("sharp must be .* int64", lambda: rs.simulate(IMAGE.astype(np.int64), LOG, CAMERA, EXPOSURE)),
    ("values must be floats, got uint8", lambda: rs.to_linear(np.zeros((4, 4), np.uint8), "srgb")),
    ("log must be a GyroLog, got PosixPath", lambda: rs.psfs(Path("gyro.csv"), CAMERA, EXPOSURE)),
    ("camera must be a Camera, got 'phone.toml'", lambda: rs.psfs(LOG, "phone.toml", EXPOSURE)),
]  # fmt: skip
SOLVERS: list[tuple[str, Call]] = [
    *((words, partial(rs.deconvolve, GREY, psf)) for words, psf in (
        ("must be positive", -KERNEL), ("larger than", np.full((201, 201), 201.0**-2)),
        ("rows of the PSFs .*500", PsfBank(KERNEL, [500.0], [10.0])), ("kernels must be", "kernel.png"))),
    # Signalling NaNs warn where they are converted.
    *(("image must be finite", partial(rs.deconvolve, signalling, KERNEL)) for signalling in SIGNALLING),
    *(("psf.*must be finite", partial(rs.deconvolve, GREY, signalling)) for signalling in SIGNALLING),
    ("noise must be", lambda: rs.deconvolve(GREY, KERNEL, noise=-1.0)),
    *((name, partial(rs.deconvolve, GREY, KERNEL, **{name: None})) for name in ("mode", "bands", "refine")),
    ("a pixel or more apart", lambda: rs.Deconvolver(impulses(0.2, 5), SHAPE)),
    ("planned shape", lambda: wiener().apply(GREY[:-1])),
    *(("linear light|real numbers", lambda image=image: wiener().apply(image)) for image in (
        GREY.astype(np.uint8), GREY.astype(int).tolist(), GREY > 0.5, GREY.astype(complex))),
    ("out must be", lambda: wiener().apply(IMAGE[..., 0], out=np.empty(SHAPE))),
    ("writable", lambda: wiener().apply(IMAGE[..., 0], out=np.broadcast_to(np.float32(0), SHAPE))),
    *((words, partial(DerivativePrior, *given)) for words, given in (
        ("kind must be", ("lasso", 0.1)), ("weight must be", ("tv", 0.0)), ("exponent must", ("tv", 1, 2)))),
    ("nsr must be", lambda: TileQuadratic(BANK, SHAPE, nsr=-1.0)),
    ("holds no picture", lambda: TileQuadratic(BANK, SHAPE).solve(1.0)),
    *((words, partial(TileQuadratic(BANK, SHAPE).apply, image, prior=DerivativePrior("tv", 0.01))) for words, image in (
        ("planned shape", GREY[1:]), ("finite", spoilt(math.inf)), ("linear light", GREY.astype(np.uint8)))),
    ("prior must be a DerivativePrior", lambda: TileQuadratic(BANK, SHAPE).apply(GREY)),
    ("picture must not have values beyond", lambda: blur().adjoint(np.full(SHAPE, 1e300))),
    ("latent must be finite", lambda: blur().forward(np.full(blur().latent_shape, np.nan))),
    ("at most 2000000000 values", lambda: deconv.RowBlur(PATHS, 10**9)),
    ("1000009x1000009 px would take", lambda: deconv.RowBlur(longest(1e6), WIDTH)),
    ("filters of 12100 tiles .* GiB", lambda: rs.Deconvolver(impulses(10, 1100), (1100, 1100), nsr=1e-6)),
]  # fmt: skip
KERNELS: list[tuple[str, Call]] = [
    *((words, partial(PsfBank.for_picture, kernels, SHAPE)) for words, kernels in (
        ("kernels must be finite", np.full((3, 3), math.nan)), ("must be positive", np.zeros((3, 3))),
        ("must have shape", np.ones(1)), (r"\(3, 0, 3\)", np.ones((3, 0, 3))))),
    *((words, partial(PsfBank, kernels, [4.0], [5.0])) for words, kernels in (
        ("odd sizes, .* 2x3", np.ones((2, 3)) / 6), ("sum of 1.008", np.full((3, 3), 0.112)),
        ("kernels must not be beyond", [[1e300]]))),
    ("rows must have shape", lambda: PsfBank(np.ones((3, 2, 1, 1)), [0, 1], [0, 1])),
    ("cols must increase", lambda: PsfBank(np.ones((3, 2, 1, 1)), [0, 1, 2], [1, 1])),
    *((words, partial(PsfBank, np.ones((3, 3)) / 9, [4.0], [5.0], displacements)) for words, displacements in (
        ("displacements must have shape", np.zeros((1, 1, 2))), ("T >= 2", np.zeros((1, 1, 1, 2))),
        ("displacements must be finite", np.full((1, 1, 2, 2), math.nan)),
        ("within the kernels", np.array([[[[0.0, 0.0], [0.0, 1.2]]]])))),
    ("softness", lambda: PsfBank(KERNEL, [4.0], [5.0], softness=0.6)),
    ("1000001x1000001 px would take", lambda: BANK.padded((1_000_001, 1_000_001))),
    ("36 x 1 PSFs of 2000003x2000003 px would take", lambda: PsfBank.from_paths(longest(1e6))),
    ("paths reach 1e.300 px", lambda: longest(1e300)),
    ("cols must be finite", lambda: BlurPaths(PATHS.displacements, PATHS.rows, [np.nan])),
    ("not finite", lambda: BlurPaths(np.full((1, 1, 2, 2), np.nan), [0.0], [0.0])),
    ("y must be a number", lambda: BANK.at("top", 0)),
    ("bands times strips", lambda: rs.psfs(LOG, Camera(4000, 3000, 3e3), EXPOSURE, bands=2000, strips=200)),
    ("points, more than", lambda: rs.psfs(turning(-8.0), Camera(4000, 3000, 3e3), EXPOSURE, bands=3000, strips=5)),
    ("blur reaches|not finite", lambda: rs.psfs(turning(np.pi), CAMERA, Exposure(0.0, 0.9))),
    ("points, more than", lambda: rs.psfs(
        GyroLog(np.arange(12_000) * 0.005, np.zeros((12_000, 3))), CAMERA, Exposure(1.0, 55.0))),
]  # fmt: skip
CAMERAS: list[tuple[str, Call]] = [
    *((name, camera(**{name: value})) for name, value in (
        ("width", 0), ("height", 48.0), ("focal_length", (80.0, -80.0)), ("focal_length", 1e-300),
        ("principal_point", (1.0,)), ("readout_time", -0.01), ("readout_direction", "down"), ("time_offset", math.inf),
        ("imu_to_camera", np.eye(2)), ("imu_to_camera", 2 * np.eye(3)))),
    *((r"determinant -1.* mirrors .* turn the sign", camera(imu_to_camera=mirror)) for mirror in (
        np.diag([1, 1, -1]), -np.eye(3), np.eye(3)[[1, 0, 2]])),
    *(("does not fit .* 48x36", partial(CAMERA.cropped, *box)) for box in ((20, 0, 29, 9), (0, 30, 10, 7))),
    *(("folds the picture", camera(focal_length=40.0, distortion_model=model, distortion=k)) for model, k in (
        ("radtan", (-1.5, 0.0, 0.0, 0.0)), ("fisheye", (-0.9, 0.0, 0.0, 0.0)))),
    *((f"coefficients, got {n}", camera(distortion_model=model, distortion=(0.1,) * n)) for model, n in (
        ("radtan", 1), ("fisheye", 5), ("none", 1))),
    ("beyond 180 degrees", camera(focal_length=2.0, **FISHEYE)),
    ("roll must be finite", lambda: rs.Correction(roll=np.inf)),
    ("drop must be", lambda: rs.triage(LOG, CAMERA, [], keep=3.0, drop=2.0)),
    ("180 degrees", lambda: burst_captures(
        LOG, Camera(WIDTH, HEIGHT, 15.0, **FISHEYE), [EXPOSURE], Translation([0.0, 0.5], NOWHERE, 1.0))),
    ("at most 100000000 pixels", lambda: rs.scene(10**6, 10**6)),
    ("at most 2000000 samples", lambda: rs.hand_shake(1e9)),
    ("10000000 warps", lambda: rs.simulate(IMAGE, LOG, CAMERA, EXPOSURE, samples=10**7)),
    ("too long to be simulated", lambda: rs.simulate(
        IMAGE, GyroLog(np.arange(120.0), np.zeros((120, 3))), CAMERA, Exposure(1.0, 110.0))),
]  # fmt: skip
LOGS: list[tuple[str, Call]] = [
    ("omega must have shape", log([0, 1, 2], np.zeros((3, 2)))),
    ("same length", log([0, 1], np.zeros((3, 3)))),
    ("at least 2", log([0], np.zeros((1, 3)))),
    ("t must be finite", log([0, math.nan, 2], np.zeros((3, 3)))),
    (r"omega must be finite, got inf at index \(1, 1\)", log([0, 1], [[0, 0, 0], [0, math.inf, 0]])),
    ("sample 2 .*is not after", log([0, 1, 1, 2], np.zeros((4, 3)))),
    ("sample 2 .*is not after", log([0, 1, 0.5, 2], np.zeros((4, 3)))),
    *(("epoch_ns", log([0, 1], NOWHERE, epoch)) for epoch in (1.7e18, "0", True, -(2**63) - 1, 2**63, 10**400)),
    *((words, partial(STILL.trimmed, *times)) for words, times in (
        ("t1 must", (0.2, 0.1)), ("t0 must", (math.nan, 0.1)), ("spans 0.0 s to 1.0 s", (2.0, 3.0)))),
    ("makes sample times equal", lambda: STILL.shifted(1e20)),
    ("b must have shape", lambda: STILL.minus_bias(0.1)),
    ("t1 must be at most", lambda: LOG.covering(0.0, 1e300, 0)),
    ("force must", lambda: AccelerationLog([0.0, 1.0], [[0, 0, 0], [1e13, 0, 0]])),
    ("t must increase", lambda: AccelerationLog([0.0, 0.0], np.ones((2, 3)))),
    *(("depth", partial(Translation, [0, 1], NOWHERE, depth)) for depth in (
        0.0, [[1.0, -1.0]], [1.0, 2.0], [[1.0], [1.0, 2.0]], [[np.nan]], np.zeros((0, 3)))),
    ("same length", lambda: Translation([0, 1, 2], NOWHERE, 1.0)),
    ("increase", lambda: Translation([1, 0], NOWHERE, 1.0)),
    ("one depth", lambda: rs.simulate(
        IMAGE, LOG, CAMERA, EXPOSURE, translation=Translation([0, 1], NOWHERE, np.ones((2, 2))))),
    ("translation track", lambda: Capture.from_log(LOG, CAMERA, EXPOSURE, Translation([0.06, 0.2], NOWHERE, 1.0))),
    ("px must", lambda: Translation.drift((3, -2, 1), CAMERA, EXPOSURE)),
    ("acceleration must", lambda: Translation.drift((3, -2), CAMERA, EXPOSURE, acceleration=(0, np.inf))),
    ("quaternion 3 .*norm 2", lambda: Trajectory(T, np.zeros((11, 3)), POSES * (1 + (T[3] == T))[:, None])),
    ("t must increase", lambda: Trajectory(T[::-1], np.zeros((11, 3)), None)),
    *((words, partial(Trajectory(T, np.zeros((11, 3)), POSES).translation, *given)) for words, given in (
        ("translation track spans", (Exposure(0.9, 0.2), CAMERA, 1.0)), ("depth", (EXPOSURE, CAMERA, 0.0)))),
    ("'opengl'", lambda: Trajectory(T, np.zeros((11, 3)), POSES).translation(EXPOSURE, CAMERA, 1.0, axes="opengl")),
]  # fmt: skip
LATER = [EXPOSURE, Exposure(0.09, 0.025), Exposure(0.13, 0.025), Exposure(0.15, 0.025)]
# What looks for a motion, a clock or a strength in pictures, what simulates, and what draws.
SEARCHES: list[tuple[str, Call]] = [
    *((words, partial(rs.calibrate, [PLAIN] * frames, exposures, LOG, CAMERA)) for words, frames, exposures in (
        ("one exposure for each frame", 4, LATER[:3]), ("one exposure for each frame", 3, LATER),
        ("order of time", 2, LATER[1::-1]))),
    ("the camera's is", lambda: rs.calibrate([PLAIN[:, :20]] * 4, LATER, LOG, CAMERA)),
    ("search must run", lambda: rs.calibrate([PLAIN] * 4, LATER, LOG, CAMERA, search=(0.1, -0.1))),
    *((words, partial(rs.calibrate_photos, [PLAIN] * 4, *given)) for words, given in (
        ("at least 3 photos, got 2", (LATER[:2], LOG, CAMERA)), ("4 images and 5", ([*LATER, EXPOSURE], LOG, CAMERA)),
        ("log must be a GyroLog", (LATER, None, CAMERA)), ("2 logs and 4 exposures", (LATER, [LOG] * 2, CAMERA)),
        ("the camera", (LATER, LOG, Camera(WIDTH + 1, HEIGHT, 60.0))))),
    *(("search must span", partial(rs.calibrate_photos, [PLAIN] * 4, LATER, LOG, CAMERA, search=search)) for search in (
        (0.01, -0.01), (-1.0, 1.0))),
    *((words, partial(rs.refine, GREY, LOG, CAMERA, EXPOSURE, free=free)) for words, free in (
        ("nothing to refine", ()), ("with known_axes=True only", "acceleration"), ("free must be a sequence", 3),
        ("free must be one of acceleration, drift, offset, readout, roll, scale; got 'focal'", ("drift", "focal")))),
    ("one exposure for each image", lambda: rs.refine([GREY] * 2, LOG, CAMERA, LATER[:3])),
    ("can hold", lambda: rs.refine(np.ones((64, 96)), LOG, Camera(96, 64, 9000.0), EXPOSURE)),
    ("rsdeblur.refine first", lambda: rs.plan(LOG, CAMERA, EXPOSURE, Options(refine=True))),
    ("drift must be at least 0", lambda: rs.Uncertainty(drift=-1.0)),
    ("nothing to refine", lambda: rs.Uncertainty(**dict.fromkeys(asdict(rs.Uncertainty()), 0.0))),
    *(("search", partial(rs.find_time_offset, np.zeros((64, 96)), LOG, Camera(96, 64, 100.0), EXPOSURE, search=search))
      for search in ((0.0, 0.001), (0.1, -0.1), (math.nan, 1.0))),
    ("64 px", lambda: rs.find_time_offset(GREY, LOG, CAMERA, EXPOSURE)),
    ("one exposure for each image", lambda: rs.find_time_offset([GREY] * 2, LOG, CAMERA, [EXPOSURE])),
    *((words, partial(rs.tuning.Tuning.of, light, BANK)) for words, lights in (
        ("linear light as floats|real numbers", (GREY.astype(kind) for kind in (np.uint8, int, bool, complex, object))),
        ("image must be finite", [spoilt(math.nan)]),
        ("image must have shape", (np.zeros(shape, "f") for shape in ((7,), (0, 7), (1, 2, 3, 4)))),
    ) for light in lights),
    *((words, partial(rs.deblur_burst, images, LOG, CAMERA, LATER[:3], **{"prior": "wiener"} | given))
      for words, images, given in (
        ('border="unknown"', [IMAGE] * 3, {"border": "unknown", "prior": "tv"}),
        ("takes no border unknown", [IMAGE] * 3, {"border": "unknown", "mode": "rowwise"}),
        ("mode must be one of auto, banded, global, rowwise", [IMAGE] * 3, {"mode": "rows"}),
        ("reference", [IMAGE] * 3, {"reference": 3}), ("2 to 64 frames", [IMAGE], {}),
        ("each frame needs an exposure", [IMAGE] * 2, {}), ("frame 2 has shape", [IMAGE, IMAGE, PLAIN], {}),
        ("frame 2: the picture is 48x12", [IMAGE, IMAGE, IMAGE[:12]], {}))),
    *(("the denoiser", lambda found=found: tiles().apply(PLAIN, prior=deconv.PlugAndPlayPrior(lambda *_: found, 0.01)))
      for found in (PIXELS, PIXELS.astype("f"), np.full(SHAPE, math.nan), None, "a", PLAIN > 0.5, PLAIN.astype("c8"))),
    *((f"{name} must be", partial(rs.scene, *size)) for name, size in (
        ("height", (63, 100)), ("width", (100, 10)), ("height", (100.5, 100)))),
    *((f"{name} must be", partial(rs.hand_shake, **{"duration": 1.0, name: value})) for name, value in (
        ("duration", 0.0), ("rate", 20.0), ("strength", -1.0))),
    *((words, partial(rs.simulate_clip, IMAGE, LOG, CAMERA, **{"exposures": [EXPOSURE]} | given)) for words, given in (
        ("at least one exposure", {"exposures": []}), ("noise must be at most", {"noise": 1e30}),
        ("samples must be", {"samples": 10**9}))),
    *((words, partial(rs.simulate, IMAGE, log, CAMERA, exposure)) for words, log, exposure in (
        (r"misses 20\.000 ms at", STILL, Exposure(-0.02, 0.05)), ("clocks", STILL, Exposure(0.1, 0.05, 10**18)),
        ("a gap of", GyroLog(T[[0, 1, 2, 3, 8, 9, 10]], np.zeros((7, 3))), Exposure(0.2, 0.4)))),
    ("picture must have shape", lambda: psf_map(BANK, SHAPE, picture=np.ones((36, 49), np.float32))),
    ("'b' has 80x61 px", lambda: side_by_side({"a": np.zeros((60, 80), "f"), "b": np.zeros((61, 80), "f")})),
    ("shape", lambda: side_by_side({"a": np.zeros(5, np.float32)})),
]  # fmt: skip
REFUSED = [*((words, partial(Options, **given)) for given, words in OPTIONS), *PICTURES, *SOLVERS, *KERNELS]
REFUSED += [*CAMERAS, *LOGS, *SEARCHES]


@pytest.mark.filterwarnings("ignore:gyro rates look like degrees", "ignore:a focal length of")
@pytest.mark.parametrize(("words", "call"), REFUSED, ids=[f"{n} {words[:40]}" for n, (words, _) in enumerate(REFUSED)])
def test_values_out_of_range_are_refused_by_name(words: str, call: Call) -> None:
    with pytest.raises((InputError, CoverageError), match=words) as refusal:
        call()
    assert len(str(refusal.value)) < LONGEST


# Nothing that any argument of these functions takes.
NEVER: dict[str, Any] = {
    "object": object(),
    "path": Path("gyro.csv"),
    "bytes": b"x",
    "empty dict": {},
    "ragged": [[0.5, 0.5], [0.5]],
    "masked": np.ma.masked_array(PLAIN, mask=PLAIN > 0.9),
    "complex": PLAIN.astype(complex),
    "text": "abc",
    "array": np.ones(5),
    "short tuple": (1,),
    "huge": 10**400,
    "NumPy's duration": np.timedelta64(1, "s"),
}


def options(function: Callable[..., Any], arguments: tuple[Any, ...], names: str) -> dict[str, Door]:
    """Return calls of a function with one keyword argument replaced."""
    prefix = getattr(function, "__name__", "")

    def replacing(name: str) -> Door:
        return lambda value: function(*arguments, **{name: value})

    return {f"{prefix}: {name}": replacing(name) for name in names.split()}


# Calls, by the function and the argument that is replaced.
CALLS: dict[str, Door] = {
    "deblur: image": lambda x: rs.deblur(x, LOG, CAMERA, EXPOSURE),
    "deblur: exposure": lambda x: rs.deblur(PLAIN, LOG, CAMERA, x),
    **options(
        rs.deblur,
        (PLAIN, LOG, CAMERA, EXPOSURE),
        "mode bands strips prior weight exponent nsr noise geometry border motion translation softness "
        "transfer normalize saturation check fallback threads max_memory out progress",
    ),
    "deconvolve: image": lambda x: rs.deconvolve(x, BANK),
    "deconvolve: psf": lambda x: rs.deconvolve(PLAIN, x),
    **options(
        rs.deconvolve,
        (PLAIN, BANK),
        "prior weight exponent nsr noise border transfer normalize saturation threads max_memory out progress",
    ),
    **options(rs.psfs, (LOG, CAMERA, EXPOSURE), "mode bands strips nsr motion translation softness"),
    "plan: options": lambda x: rs.plan(LOG, CAMERA, EXPOSURE, x),
    "Plan.apply: image": lambda x: plan().apply(x),
    "Plan.prepare: image": lambda x: plan().prepare(x),
    "GyroLog: omega": lambda x: GyroLog([0, 1], x),
    "GyroLog: epoch_ns": lambda x: GyroLog([0, 1], [[0, 0, 0], [0, 0, 0]], x),
    "minus_bias: b": LOG.minus_bias,
    "covering: t0": lambda x: LOG.covering(x, 0.1, 0),
    "Camera: width": lambda x: Camera(x, 36, 60.0),
    **options(
        Camera,
        (48, 36, 60.0),
        "principal_point readout_time readout_direction time_offset distortion_model distortion timestamp_marks",
    ),
    "rays: points": CAMERA.rays,
    "scaled: s": CAMERA.scaled,
    "cropped: left": lambda x: CAMERA.cropped(x, 0, 10, 10),
    "Exposure: start": lambda x: Exposure(x, 0.1),
    "window: camera": lambda x: EXPOSURE.window([1.0], x),
    "Translation: position": lambda x: rs.Translation([0, 1], x, 1.0),
    "from_log: log": lambda x: Capture.from_log(x, CAMERA, EXPOSURE),
    "from_capture: capture": lambda x: BlurPaths.from_capture(x, [1.0], [1.0]),
    "every_row: within": lambda x: BlurPaths.every_row(Capture.from_log(LOG, CAMERA, EXPOSURE), [1.0], within=x),
    "BlurPaths: displacements": lambda x: BlurPaths(x, [1.0], [1.0]),
    "PsfBank: kernels": lambda x: PsfBank(x, [1.0], [1.0]),
    "for_picture: shape": lambda x: PsfBank.for_picture(np.ones((1, 1)), x),
    "cut: rows": lambda x: BANK.cut(x, slice(0, 9)),
    "turned: height": BANK.turned,
    "Deconvolver: bank": lambda x: rs.Deconvolver(x, SHAPE),
    **options(rs.Deconvolver, (BANK, SHAPE), "nsr border threads"),
    "Deconvolver.apply: image": lambda x: wiener().apply(x),
    "TileQuadratic.apply: image": lambda x: tiles().apply(x, prior=PRIOR),
    "RowDeconvolver: paths": lambda x: deconv.RowDeconvolver(x, SHAPE),
    **options(deconv.RowDeconvolver, (PATHS, SHAPE), "nsr border threads"),
    "RowDeconvolver.apply: image": lambda x: rows().apply(x),
    "RowBlur: paths": lambda x: deconv.RowBlur(x, 48),
    "forward: latent": lambda x: blur().forward(x),
    "DerivativePrior: kind": lambda x: deconv.DerivativePrior(x, 0.1),
    "PlugAndPlayPrior: denoise": lambda x: deconv.PlugAndPlayPrior(x, 0.1),
    "Tuning.of: light": lambda x: rs.tuning.Tuning.of(x, BANK),
    "refine: image": lambda x: rs.refine(x, LOG, CAMERA, EXPOSURE),
    **options(rs.refine, (PLAIN, LOG, CAMERA, EXPOSURE), "translation uncertainty transfer known_axes progress"),
    "refine of several: exposure": lambda x: rs.refine([PLAIN] * 2, LOG, CAMERA, [x] * 2),
    **options(rs.Uncertainty, (), "scale drift offset readout roll"),
    **options(rs.Correction, (), "scale drift_x drift_y offset readout roll"),
    "calibrate: exposures": lambda x: rs.calibrate([PLAIN] * 2, x, LOG, CAMERA),
    **options(rs.calibrate, ([PLAIN] * 2, [EXPOSURE] * 2, LOG, CAMERA), "search progress"),
    "simulate_clip: exposures": lambda x: list(rs.simulate_clip(PLAIN, LOG, CAMERA, x)),
    "Trajectory.translation: exposure": lambda x: TRAJECTORY.translation(x, CAMERA, 1.0),
    "Translation.drift: known": lambda x: rs.Translation.drift((1, 0), CAMERA, EXPOSURE, known=x),
    "PsfBank.padded: size": BANK.padded,
    "BlurPaths: softness": lambda x: BlurPaths(PATHS.displacements, PATHS.rows, PATHS.cols, x),
    "triage: log": lambda x: rs.triage(x, CAMERA, [EXPOSURE]),
    **options(rs.triage, (LOG, CAMERA, [EXPOSURE]), "keep drop progress"),
    "find_time_offset: exposure": lambda x: rs.find_time_offset([PLAIN], LOG, CAMERA, [x]),
    "simulate: sharp": lambda x: rs.simulate(x, LOG, CAMERA, EXPOSURE),
    **options(rs.simulate, (PLAIN, LOG, CAMERA, EXPOSURE), "noise samples translation transfer"),
    "scene: height": lambda x: rs.scene(x, 64),
    "hand_shake: duration": rs.hand_shake,
    "read_camera: size": lambda x: rs.read_camera("camera.toml", size=x),
    "write_picture: force": lambda x: rs.write_picture("a.png", PIXELS, force=x),
    "to_linear: transfer": lambda x: rs.to_linear(PLAIN, x),
}
# Values that an argument does take.
FITS = {("deblur: max_memory", "huge"), ("deconvolve: max_memory", "huge")}
# Arguments that may be None.
OPTIONAL = {
    "translation", "threads", "max_memory", "out", "progress", "options", "principal_point", "size", "bits", "like",
    "uncertainty", "mode", "prior", "known", "sd",
}  # fmt: skip


def fault(call: str, value: Any) -> str | None:
    """Return what is wrong with the answer to a value that is no argument."""
    # Linear light is an image, whatever the argument is called.
    argument = {"light": "image"}.get(name := call.rpartition(": ")[2], name)
    try:
        CALLS[call](value)
    except rs.RsdeblurError as refusal:
        text = str(refusal)
        return None if re.search(rf"\b{argument}\b", text) and len(text) < 500 else text
    except Exception as error:
        return repr(error)
    return "taken"


@pytest.mark.parametrize("call", CALLS)
def test_what_is_no_argument_is_refused_by_name(call: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    values = NEVER if call.rpartition(": ")[2] in OPTIONAL else NEVER | {"none": None}
    for kind in values:
        if (call, kind) in FITS:
            CALLS[call](values[kind])
    faults = {kind: fault(call, value) for kind, value in values.items() if (call, kind) not in FITS}
    assert {kind: text for kind, text in faults.items() if text is not None} == {}


@pytest.mark.parametrize("function", [rs.read_gyro, rs.read_camera, rs.read_captures, rs.read_picture, BANK.save])
def test_what_is_no_path_is_refused(function: Door) -> None:
    for path in (None, 1, True, 1.5, b"a.csv", [], PIXELS):
        with pytest.raises(InputError, match="path must be the path of a file, got"):
            function(path)


def test_noise_of_minus_zero_is_none() -> None:
    assert np.isfinite(rs.simulate(PLAIN, LOG, CAMERA, EXPOSURE, noise=-0.0).blurred).all()


def test_lists_are_taken_for_arrays() -> None:
    picture, paths = PLAIN.tolist(), PATHS
    expected = rs.deblur(PLAIN.astype(np.float64), LOG, CAMERA, EXPOSURE, prior="wiener", nsr=0.01).image
    np.testing.assert_array_equal(rs.deblur(picture, LOG, CAMERA, EXPOSURE, prior="wiener", nsr=0.01).image, expected)
    np.testing.assert_array_equal(wiener().apply(picture), wiener().apply(PLAIN))
    np.testing.assert_array_equal(
        BlurPaths(paths.displacements.tolist(), paths.rows.tolist(), paths.cols.tolist()).displacements,
        paths.displacements,
    )
    np.testing.assert_array_equal(CAMERA.rays([[1, 2], [3, 4]]), CAMERA.rays(np.array([[1.0, 2.0], [3.0, 4.0]])))
    np.testing.assert_array_equal(CAMERA.project([0.1, 0.2, 1]), CAMERA.project(np.array([0.1, 0.2, 1.0])))
    np.testing.assert_array_equal(rs.to_linear(picture, "srgb"), rs.to_linear(PLAIN.astype(np.float64), "srgb"))
    assert Camera(48, 36, [60, 60], [23.5, 17.5]).focal_length == (60.0, 60.0)
