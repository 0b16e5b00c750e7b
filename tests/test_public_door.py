"""Every public function refuses what is no argument, by name, with an error of the package; lists are arrays."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsdeblur as rs
from rsdeblur import Camera, Exposure, GyroLog, InputError, PsfBank, deconv
from rsdeblur.motion import BlurPaths, Capture, Trajectory

SHAPE = (36, 48)
LOG, CAMERA, EXPOSURE = rs.hand_shake(0.2, strength=1.0, seed=3), Camera(48, 36, 60.0), Exposure(0.05, 0.025)
IMAGE = np.random.default_rng(0).random(SHAPE, dtype=np.float32)
BANK = PsfBank.for_picture(np.full((1, 5), 0.2), SHAPE)
CAPTURE = Capture.from_log(LOG, CAMERA, EXPOSURE)
PATHS = BlurPaths.every_row(CAPTURE, [20.0])
TRAJECTORY = Trajectory([0, 1], [[0, 0, 0], [1, 0, 0]], [[0, 0, 0, 1]] * 2)
WIENER, TILES, ROWS = (
    rs.Deconvolver(BANK, SHAPE),
    deconv.TileQuadratic(BANK, SHAPE),
    deconv.RowDeconvolver(PATHS, SHAPE),
)
BLUR, PLAN, PRIOR = deconv.RowBlur(PATHS, 48), rs.plan(LOG, CAMERA, EXPOSURE), deconv.DerivativePrior("tv", 0.01)
PIXELS = np.zeros((4, 4), np.uint8)

# Nothing that any argument of these functions takes.
NEVER: dict[str, Any] = {
    "object": object(),
    "path": Path("gyro.csv"),
    "bytes": b"x",
    "empty dict": {},
    "ragged": [[0.5, 0.5], [0.5]],
    "masked": np.ma.masked_array(IMAGE, mask=IMAGE > 0.9),
    "complex": IMAGE.astype(complex),
    "text": "abc",
    "array": np.ones(5),
    "short tuple": (1,),
    "huge": 10**400,
    "NumPy's duration": np.timedelta64(1, "s"),
}
Call = Callable[[Any], Any]


def options(function: Callable[..., Any], arguments: tuple[Any, ...], names: str) -> dict[str, Call]:
    """Return calls of a function with one keyword argument replaced."""
    prefix = getattr(function, "__name__", "")

    def replacing(name: str) -> Call:
        return lambda value: function(*arguments, **{name: value})

    return {f"{prefix}: {name}": replacing(name) for name in names.split()}


# Calls, by the function and the argument that is replaced.
CALLS: dict[str, Call] = {
    "deblur: image": lambda x: rs.deblur(x, LOG, CAMERA, EXPOSURE),
    "deblur: exposure": lambda x: rs.deblur(IMAGE, LOG, CAMERA, x),
    **options(
        rs.deblur,
        (IMAGE, LOG, CAMERA, EXPOSURE),
        "mode bands strips prior weight exponent nsr noise solver geometry border motion translation softness "
        "transfer normalize saturation check fallback planning threads max_memory out progress",
    ),
    "deconvolve: image": lambda x: rs.deconvolve(x, BANK),
    "deconvolve: psf": lambda x: rs.deconvolve(IMAGE, x),
    **options(
        rs.deconvolve,
        (IMAGE, BANK),
        "prior weight exponent nsr noise border transfer normalize saturation planning threads max_memory out progress",
    ),
    **options(rs.psfs, (LOG, CAMERA, EXPOSURE), "mode bands strips nsr motion translation softness"),
    "plan: options": lambda x: rs.plan(LOG, CAMERA, EXPOSURE, x),
    "Plan.apply: image": lambda x: PLAN.apply(x),
    "Plan.prepare: image": lambda x: PLAN.prepare(x),
    "GyroLog: omega": lambda x: GyroLog([0, 1], x),
    "GyroLog: epoch_ns": lambda x: GyroLog([0, 1], [[0, 0, 0], [0, 0, 0]], x),
    "minus_bias: b": LOG.minus_bias,
    "gaps: factor": lambda x: LOG.gaps(factor=x),
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
    "every_row: within": lambda x: BlurPaths.every_row(CAPTURE, [1.0], within=x),
    "BlurPaths: displacements": lambda x: BlurPaths(x, [1.0], [1.0]),
    "PsfBank: kernels": lambda x: PsfBank(x, [1.0], [1.0]),
    "for_picture: shape": lambda x: PsfBank.for_picture(np.ones((1, 1)), x),
    "cut: rows": lambda x: BANK.cut(x, slice(0, 9)),
    "turned: height": BANK.turned,
    "Deconvolver: bank": lambda x: rs.Deconvolver(x, SHAPE),
    **options(rs.Deconvolver, (BANK, SHAPE), "nsr border planning threads"),
    "Deconvolver.apply: image": WIENER.apply,
    "Deconvolver.replan: bank": WIENER.replan,
    "TileQuadratic.apply: image": lambda x: TILES.apply(x, prior=PRIOR),
    "RowDeconvolver: paths": lambda x: deconv.RowDeconvolver(x, SHAPE),
    **options(deconv.RowDeconvolver, (PATHS, SHAPE), "nsr solver border planning threads"),
    "RowDeconvolver.apply: image": ROWS.apply,
    "RowBlur: paths": lambda x: deconv.RowBlur(x, 48),
    "forward: latent": BLUR.forward,
    "DerivativePrior: kind": lambda x: deconv.DerivativePrior(x, 0.1),
    "PlugAndPlayPrior: denoise": lambda x: deconv.PlugAndPlayPrior(x, 0.1),
    "Tuning.of: light": lambda x: rs.estimate.Tuning.of(x, BANK),
    "Layer: opacity": lambda x: rs.simulation.Layer(IMAGE, x),
    "refine: image": lambda x: rs.refine(x, LOG, CAMERA, EXPOSURE),
    **options(rs.refine, (IMAGE, LOG, CAMERA, EXPOSURE), "translation uncertainty transfer known_axes progress"),
    "refine of several: exposure": lambda x: rs.refine([IMAGE] * 2, LOG, CAMERA, [x] * 2),
    **options(rs.Uncertainty, (), "scale drift offset readout roll"),
    **options(rs.Correction, (), "scale drift_x drift_y offset readout roll"),
    "Estimate: value": lambda x: rs.calibration.Estimate(x, 0.1, "s"),
    "calibrate: exposures": lambda x: rs.calibrate([IMAGE] * 2, x, LOG, CAMERA),
    **options(rs.calibrate, ([IMAGE] * 2, [EXPOSURE] * 2, LOG, CAMERA), "search progress"),
    "simulate_clip: exposures": lambda x: list(rs.simulate_clip(IMAGE, LOG, CAMERA, x)),
    "Trajectory.translation: exposure": lambda x: TRAJECTORY.translation(x, CAMERA, 1.0),
    "Translation.drift: known": lambda x: rs.Translation.drift((1, 0), CAMERA, EXPOSURE, known=x),
    "PsfBank.padded: size": BANK.padded,
    "BlurPaths: softness": lambda x: BlurPaths(PATHS.displacements, PATHS.rows, PATHS.cols, x),
    "triage: log": lambda x: rs.triage(x, CAMERA, [EXPOSURE]),
    **options(rs.triage, (LOG, CAMERA, [EXPOSURE]), "keep drop progress"),
    "find_time_offset: exposure": lambda x: rs.find_time_offset([IMAGE], LOG, CAMERA, [x]),
    "simulate: sharp": lambda x: rs.simulate(x, LOG, CAMERA, EXPOSURE),
    **options(rs.simulate, (IMAGE, LOG, CAMERA, EXPOSURE), "noise samples translation transfer"),
    "scene: height": lambda x: rs.scene(x, 64),
    "hand_shake: duration": rs.hand_shake,
    "read_camera: size": lambda x: rs.read_camera("camera.toml", size=x),
    "write_picture: force": lambda x: rs.write_picture("a.png", PIXELS, force=x),
    "to_linear: transfer": lambda x: rs.to_linear(IMAGE, x),
    "show_config: mode": rs.show_config,
}
# Values that an argument does take.
FITS = {
    ("deblur: max_memory", "huge"),
    ("deconvolve: max_memory", "huge"),
}
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
def test_what_is_no_path_is_refused(function: Call) -> None:
    for path in (None, 1, True, 1.5, b"a.csv", [], PIXELS):
        with pytest.raises(InputError, match="path must be the path of a file, got"):
            function(path)


def test_noise_of_minus_zero_is_none() -> None:
    assert np.isfinite(rs.simulate(IMAGE, LOG, CAMERA, EXPOSURE, noise=-0.0).blurred).all()


def test_lists_are_taken_for_arrays() -> None:
    picture, paths = IMAGE.tolist(), PATHS
    expected = rs.deblur(IMAGE.astype(np.float64), LOG, CAMERA, EXPOSURE, prior="wiener", nsr=0.01).image
    np.testing.assert_array_equal(rs.deblur(picture, LOG, CAMERA, EXPOSURE, prior="wiener", nsr=0.01).image, expected)
    np.testing.assert_array_equal(WIENER.apply(picture), WIENER.apply(IMAGE))
    np.testing.assert_array_equal(
        BlurPaths(paths.displacements.tolist(), paths.rows.tolist(), paths.cols.tolist()).displacements,
        paths.displacements,
    )
    np.testing.assert_array_equal(CAMERA.rays([[1, 2], [3, 4]]), CAMERA.rays(np.array([[1.0, 2.0], [3.0, 4.0]])))
    np.testing.assert_array_equal(CAMERA.project([0.1, 0.2, 1]), CAMERA.project(np.array([0.1, 0.2, 1.0])))
    np.testing.assert_array_equal(rs.to_linear(picture, "srgb"), rs.to_linear(IMAGE.astype(np.float64), "srgb"))
    assert Camera(48, 36, [60, 60], [23.5, 17.5]).focal_length == (60.0, 60.0)
