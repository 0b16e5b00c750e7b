"""Laws that hold for deblurred pictures of random cameras, logs, exposures, sizes and modes.

Every test takes its cases from hypothesis, the same ones each time.
"""

import itertools
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import rsdeblur
from rsdeblur import Camera, Exposure, GyroLog, InputError, psfs
from rsdeblur.choices import BORDERS, BOUNDARIES, MODES, READOUT_DIRECTIONS
from rsdeblur.motion import BlurPaths, Capture
from tests.installed import PRIORS

# The published method's filter unless a test says otherwise: fast, and linear in the picture.
deblur = partial(rsdeblur.deblur, prior="wiener")

EPOCH = 1_766_385_749_427_863_801
MIRRORED = {"left-right": "right-left", "right-left": "left-right", "top-down": "bottom-up", "bottom-up": "top-down"}

few = settings(derandomize=True, deadline=None, max_examples=8)
several = settings(derandomize=True, deadline=None, max_examples=12)


@dataclass(frozen=True)
class Taken:
    """Log, camera and exposure of a picture."""

    log: GyroLog
    camera: Camera
    exposure: Exposure

    @property
    def parts(self) -> tuple[GyroLog, Camera, Exposure]:
        return self.log, self.camera, self.exposure

    def noise(self, seed: int = 0, channels: int = 1) -> np.ndarray[Any, Any]:
        shape = (self.camera.height, self.camera.width, channels)
        return np.random.default_rng(seed).random(shape, dtype=np.float32)


@st.composite
def captures(draw: st.DrawFn, directions: tuple[str, ...] = READOUT_DIRECTIONS) -> Taken:
    """Draw a camera, held in any way, with a few px of blur in pictures of odd, even and prime sizes."""
    width, height = draw(st.integers(24, 60)), draw(st.integers(24, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    model = draw(st.sampled_from(["none", "radtan", "fisheye"]))
    bent = {"none": (), "radtan": (-0.05, 0.01, 0.002, -0.001), "fisheye": (0.03, 0.01, -0.01, 0.001)}[model]
    camera = Camera(
        width,
        height,
        draw(st.floats(40, 90)) * np.array([1.0, draw(st.floats(0.9, 1.1))]),
        (width / 2 + draw(st.floats(-4, 4)), height / 2 + draw(st.floats(-4, 4))),
        readout_time=draw(st.sampled_from([0.0, 0.01, 0.03])),
        readout_direction=draw(st.sampled_from(directions)),
        imu_to_camera=Rotation.from_quat(rng.normal(size=4)).as_matrix(),  # any direction
        time_offset=draw(st.floats(-0.02, 0.02)),
        distortion_model=model,
        distortion=bent,
        timestamp_marks=draw(st.sampled_from(["start", "middle", "end"])),
    )
    t = np.cumsum(rng.uniform(0.003, 0.006, 60))
    waves = rng.normal(0, 0.8, (3, 3, 1)) * np.sin(rng.uniform(5, 60, (3, 3, 1)) * t + rng.uniform(0, 6, (3, 3, 1)))
    return Taken(GyroLog(t, waves.sum(axis=0).T, EPOCH), camera, Exposure(0.13, draw(st.floats(0.005, 0.05)), EPOCH))


modes = st.sampled_from(MODES)
# Strengths that do not depend on the picture, so that the result is linear in it.
LINEAR: dict[str, dict[str, Any]] = {
    "wiener": {"prior": "wiener", "nsr": 0.02},
    "gradient": {"prior": "gradient", "nsr": 0.002, "weight": 0.01},
}


def solved(capture: Taken, image: np.ndarray[Any, Any], **options: Any) -> np.ndarray[Any, Any]:
    return deblur(image, *capture.parts, bands=3, strips=2, check=False, **options).image


@few
@given(captures(), modes, st.sampled_from(PRIORS), st.just(0.0) | st.floats(0.05, 1))
def test_an_even_picture_stays_as_it_is(capture: Taken, mode: str, prior: str, level: float) -> None:
    image = np.full((capture.camera.height, capture.camera.width), level, np.float32)
    # float32 transforms, and rowwise solves whose condition number is up to 1 / nsr
    np.testing.assert_allclose(solved(capture, image, mode=mode, prior=prior, nsr=0.01), image, rtol=1e-4, atol=1e-6)


@few
@given(captures(), modes, st.sampled_from(sorted(LINEAR)), st.sampled_from([1, 3]), st.floats(-2, 2))
def test_linear_in_the_picture(capture: Taken, mode: str, prior: str, channels: int, factor: float) -> None:
    one, other = capture.noise(1, channels), capture.noise(2, channels)
    options = {"mode": mode, **LINEAR[prior]}
    together = solved(capture, one + np.float32(factor) * other, **options)
    apart = solved(capture, one, **options) + np.float32(factor) * solved(capture, other, **options)
    # The filter's gain, up to 1 / (2 sqrt(nsr)) = 11 for the smallest nsr, on float32's 1e-7 of values up to 3.
    np.testing.assert_allclose(together, apart, atol=1e-4)


@few
@given(captures(), modes, st.integers(-(2**40), 2**40))
def test_a_later_epoch_changes_nothing(capture: Taken, mode: str, later: int) -> None:
    log, camera, exposure = capture.parts
    moved = Taken(
        GyroLog(log.t, log.omega, EPOCH + later), camera, replace(exposure, epoch_ns=exposure.epoch_ns + later)
    )
    image = capture.noise()
    options: dict[str, Any] = {"mode": mode, "nsr": 0.02}
    np.testing.assert_array_equal(solved(moved, image, **options), solved(capture, image, **options))


@several
@given(captures(), st.floats(-50, 50))
def test_timestamps_and_offsets_move_together(capture: Taken, dt: float) -> None:
    log, camera, exposure = capture.parts
    kernels = psfs(*capture.parts, bands=3, strips=2).kernels
    later = replace(exposure, start=exposure.start + dt)
    # The gyro's clock with its offset, the camera's clock, and both clocks. Times of 50 s have steps of 7e-15 s.
    for moved in (
        (log.shifted(dt), replace(camera, time_offset=camera.time_offset - dt), exposure),
        (log, replace(camera, time_offset=camera.time_offset + dt), later),
        (log.shifted(dt), camera, later),
    ):
        np.testing.assert_allclose(psfs(*moved, bands=3, strips=2).kernels, kernels, atol=1e-6)


def mirrored(capture: Taken, axis: int) -> Taken:
    """Return the capture of the picture mirrored along `axis`: 0 is upside down."""
    camera = capture.camera
    along_x = axis == 1
    (cx, cy), k = camera.principal_point, list(camera.distortion)
    if camera.distortion_model == "radtan":
        # Decentring: p1 goes with y, p2 with x.
        k[3 if along_x else 2] *= -1
    turns = camera.horizontal_readout == along_x
    direction = MIRRORED[camera.readout_direction] if turns else camera.readout_direction
    # Rates are axial vectors: mirrored in x, only the rate about x keeps its sign.
    signs = np.diag([1.0, -1.0, -1.0] if along_x else [-1.0, 1.0, -1.0])
    mirror = replace(
        camera,
        principal_point=(camera.width - 1 - cx, cy) if along_x else (cx, camera.height - 1 - cy),
        readout_direction=direction,
        imu_to_camera=signs @ camera.imu_to_camera,
        distortion=tuple(k),
    )
    return replace(capture, camera=mirror)


@several
@given(captures(), st.sampled_from([0, 1]))
def test_psfs_of_a_mirrored_camera_are_mirrored(capture: Taken, axis: int) -> None:
    kernels = psfs(*capture.parts, bands=3, strips=2).kernels
    mirror = psfs(*mirrored(capture, axis).parts, bands=3, strips=2).kernels
    # Paths differ by rounding in float64; a weight changes by up to 1 per px of its path's place.
    np.testing.assert_allclose(np.flip(mirror, (axis, axis + 2)), kernels, atol=1e-6)


@several
@given(captures(("top-down", "bottom-up")), st.integers(2, 7))
def test_paths_scale_with_the_camera(capture: Taken, times: int) -> None:
    # Without readout, because rows of another picture are read at other moments.
    log, camera, exposure = capture.log, replace(capture.camera, readout_time=0.0), capture.exposure
    large = camera.resized(times * camera.width, times * camera.height)
    rows, cols = np.array([0.0, camera.height / 2]), np.array([3.0, camera.width - 1.0])
    paths = BlurPaths.from_capture(Capture.from_log(log, camera, exposure), rows, cols)
    scaled = BlurPaths.from_capture(
        Capture.from_log(log, large, exposure), (rows + 0.5) * times - 0.5, (cols + 0.5) * times - 0.5
    )
    # Longer paths have more samples, but their ends do not depend on the samples.
    for place in (0, -1):
        np.testing.assert_allclose(
            scaled.displacements[:, :, place], times * paths.displacements[:, :, place], atol=1e-6 * times
        )


# From 128 px of transform width, threads share the columns of a single tile.
WIDE = Camera(136, 40, 136.0, readout_time=0.02)
SHAKE = rsdeblur.hand_shake(0.4, strength=0.4, seed=1)
WINDOWS = Exposure(0.15, 0.03), Exposure(0.25, 0.03)


@pytest.mark.parametrize("softness", [0.0, 0.8])
@pytest.mark.parametrize("mode", MODES)
def test_any_number_of_threads_gives_the_same_bits(mode: str, softness: float) -> None:
    image = np.random.default_rng(0).random((WIDE.height, WIDE.width, 3), dtype=np.float32)
    # Each prior with another border; the CNN, which takes as long as all others, in tests/deconv/test_cnn.py.
    borders = itertools.cycle(BORDERS if mode == "rowwise" else (*BORDERS, *BOUNDARIES))
    for n, (prior, border) in enumerate(zip([p for p in PRIORS if p != "cnn"], borders, strict=False)):
        turns = {"bands": 1 + n // 2 % 2, "strips": 1 + n // 4 % 2}
        options = {"mode": mode, "prior": prior, "softness": softness, "border": border, "nsr": 0.01, **turns}
        one, two = (
            deblur(image, SHAKE, WIDE, WINDOWS[0], check=False, threads=threads, **options).image for threads in (1, 2)
        )
        np.testing.assert_array_equal(two, one, err_msg=str(options))


@pytest.mark.parametrize(("mode", "prior"), [("banded", "tv"), ("rowwise", "wiener")])
def test_any_number_of_threads_gives_the_same_bits_of_a_burst(mode: str, prior: str) -> None:
    images = np.random.default_rng(0).random((2, WIDE.height, WIDE.width, 3), dtype=np.float32)
    one, two = (
        rsdeblur.deblur_burst(
            list(images), SHAKE, WIDE, WINDOWS, mode=mode, prior=prior, softness=0.8, check=False, threads=threads
        ).result.image
        for threads in (1, 2)
    )
    np.testing.assert_array_equal(two, one)


CASES = """
import numpy as np
from rsdeblur import Camera, Exposure, deblur
from rsdeblur.simulation.shake import hand_shake
image = np.random.default_rng(0).random((31, 37, 3), dtype=np.float32)
log, camera = hand_shake(0.2, strength=0.5, seed=3), Camera(37, 31, 60.0, readout_time=0.03)
np.savez(path, **{
    f"{mode} {prior}": deblur(image, log, camera, Exposure(0.05, 0.02), mode=mode, prior=prior, nsr=0.02,
                              weight="auto" if prior == "wiener" else 0.01, bands=3, strips=2, check=False).image
    for mode in ("global", "banded", "rowwise") for prior in ("wiener", "tv")
})
"""


def test_c_and_numpy_agree(tmp_path: Path) -> None:
    """Compare the results of the C code with those of its NumPy twins; its own tests compare its SIMD levels."""
    here, pure = tmp_path / "here.npz", tmp_path / "pure.npz"
    exec(CASES, {"path": here})
    environment = {**os.environ, "RSDEBLUR_PURE": "1"}
    subprocess.run([sys.executable, "-c", f"path = {str(pure)!r}{CASES}"], check=True, env=environment)
    with np.load(here) as found, np.load(pure) as expected:
        for name in expected:
            # Measured: the same bits in global and banded, 4e-7 and 1e-6 (total variation) in rowwise.
            np.testing.assert_allclose(found[name], expected[name], atol=1e-5, err_msg=name)


SIZES = [(1, 1), (1, 2), (2, 1), (1, 31), (31, 1), (2, 2), (3, 3), (5, 4), (13, 17), (31, 29), (64, 3), (3, 64)]


@several
@given(
    st.sampled_from(SIZES), modes, st.sampled_from(PRIORS), st.sampled_from(["uint8", "uint16", "float32"]), st.data()
)
@example((1, 1), "banded", "wiener", "uint8", None)
def test_any_size_is_deblurred_or_refused(size, mode, prior, dtype, data):
    """The picture of a still camera is unchanged; that of a shaken one is finite, and an even one stays even."""
    height, width = size
    speed, even = (0.0, False) if data is None else (data.draw(st.sampled_from([0.0, 0.3])), data.draw(st.booleans()))
    t = np.arange(40) * 0.005
    log = GyroLog(t, np.full((40, 3), speed) * min(size) / 5)
    noise = np.random.default_rng(0).random((height, width, 3)).astype(np.float32)
    stored = np.full_like(noise, 0.4) if even else noise
    if dtype != "float32":
        stored = (stored * np.iinfo(dtype).max).astype(dtype)
    full = 1 if dtype == "float32" else np.iinfo(dtype).max
    given = (stored, log, Camera(width, height, 60.0, readout_time=0.02), Exposure(0.05, 0.02))
    options: dict[str, Any] = {"mode": mode, "prior": prior, "nsr": 0.01, "transfer": "linear"}
    if width < 3 or (height < 3 and mode != "rowwise"):
        # The smallest PSF does not fit. Rowwise solves for rows beyond the frame.
        with pytest.raises(InputError, match="picture"):
            deblur(*given, **options)
        return
    sharp = deblur(*given, **options).image
    assert sharp.shape == stored.shape
    assert np.isfinite(sharp).all()
    if even or (speed == 0 and prior == "wiener"):
        np.testing.assert_allclose(sharp, stored / np.float32(full), atol=1e-4)


@pytest.mark.parametrize(("mode", "axis"), [("global", 0), ("banded", 1), ("rowwise", 0)])
def test_a_psf_as_large_as_the_picture(mode: str, axis: int) -> None:
    """The longest blur that fits is solved; a blur that is longer by 1 px on both sides is refused."""
    side, focal_length, exposure = 41, 600.0, Exposure(0.05, 0.02)
    image = np.random.default_rng(0).random((side, side), dtype=np.float32)

    def log(reach: float) -> GyroLog:
        # A constant rate blurs evenly to both sides of the middle.
        rates = np.zeros((40, 3))
        rates[:, axis] = 2 * np.arctan(reach / focal_length) / exposure.duration
        return GyroLog(np.arange(40) * 0.005, rates)

    result = deblur(image, log(19.5), Camera(side, side, focal_length), exposure, mode=mode, nsr=0.05, check=False)
    assert result.psfs.size[axis] == side
    assert np.isfinite(result.image).all()
    with pytest.raises(InputError, match=r"the blur reaches .* more than the picture of 41x41 px can hold"):
        deblur(image, log(20.5), Camera(side, side, focal_length), exposure, mode=mode, nsr=0.05)
