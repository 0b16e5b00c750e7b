"""Options: one set of defaults for Python and the command line, and their checks."""

import inspect
from dataclasses import fields, replace
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from rsdeblur import Camera, Correction, Exposure, InputError, Options, deblur, hand_shake, plan, scene, simulate
from rsdeblur.choices import QUALITIES, Quality
from rsdeblur.cli import main
from rsdeblur.cli.batch import command as batch
from rsdeblur.cli.compare import command as compare
from rsdeblur.cli.deblur import command as deblur_command
from rsdeblur.cli.video import command as video
from rsdeblur.estimate import Refinement
from rsdeblur.image.transfer import from_linear
from rsdeblur.io import read_camera, read_gyro, read_picture, write_picture

DEFAULTS = {field.name: field.default for field in fields(Options)}
CAMERA, EXPOSURE = Camera(96, 80, 110.0, readout_time=0.03), Exposure(0.05, 1 / 30)


def test_the_keywords_of_deblur_are_the_options() -> None:
    keywords = {
        name: parameter.default
        for name, parameter in inspect.signature(deblur).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    }
    assert keywords == DEFAULTS | {"out": None, "progress": None}


@pytest.mark.parametrize(
    ("command", "differing"),
    [
        # Not given, which is yes unless that would be slow or impossible.
        (deblur_command, {"refine": None}),
        (batch, {"refine": None}),
        (compare, {}),
        # For speed.
        (video, {"quality": "fast"}),
    ],
)
def test_the_command_line_has_the_same_defaults(command: click.Command, differing: dict[str, object]) -> None:
    options = {option.name: option for option in command.params if option.name in DEFAULTS}
    assert len(options) > 12
    given = command.make_context(command.name, ["file"], resilient_parsing=True).params
    assert {name: given[name] for name in options if given[name] != DEFAULTS[name]} == differing
    for name, option in options.items():
        if isinstance(option.type, click.Choice):
            with pytest.raises(InputError, match=f"{name} must be one of {', '.join(sorted(option.type.choices))}"):
                Options(**{name: "?"})


def test_python_and_the_command_line_give_the_same_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a photo with lamps, as it is and after a correction that both ask for in the same way."""
    camera, exposure, log = Camera(192, 144, 280.0, readout_time=0.02), Exposure(0.5, 1 / 20), hand_shake(1.2, seed=5)
    np.savetxt(tmp_path / "log.csv", np.column_stack([log.t, log.omega]), "%.9f", ",", header="t,wx,wy,wz", comments="")
    camera.save(tmp_path / "camera.toml")
    sources = ["--gyro", tmp_path / "log.csv", "--camera", tmp_path / "camera.toml", "--start", "0.5"]
    recording = read_gyro(tmp_path / "log.csv"), read_camera(tmp_path / "camera.toml"), exposure
    lamps, asked = scene(176, 224), []
    lamps[70:73, 100:103] = lamps[90:93, 50:53] = 30.0
    blurred = simulate(lamps, log, camera, exposure, noise=0.005).blurred
    photo = np.rint(255 * from_linear(blurred.clip(0, 1), "srgb")).astype(np.uint8)
    write_picture(tmp_path / "photo.png", photo)
    late = replace(camera, time_offset=2e-3)

    def refined(images, *given, known_axes, **_):
        asked.append((np.asarray(images).tobytes(), *given, known_axes))
        return Refinement(log, late, exposure, None, True, "", Correction(offset=2e-3), Correction(), 0.9, 9.0, 0.05)

    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", refined)
    for refine in (False, True):
        call = [
            "deblur",
            tmp_path / "photo.png",
            *sources,
            "--duration",
            "1/20",
            "--force",
            "-o",
            tmp_path / "sharp.png",
        ]
        call.append("--refine" if refine else "--no-refine")
        assert CliRunner().invoke(main, list(map(str, call)), catch_exceptions=False).exit_code == 0
        result = deblur(photo, *recording, refine=refine, out=np.empty_like(photo))
        assert "highlights" in result.timings
        assert (next(iter(result.timings)) == "refine") == refine
        np.testing.assert_array_equal(read_picture(tmp_path / "sharp.png").pixels, result.image)
    assert len(asked) == 2
    assert asked[0] == asked[1]


def test_automatic_saturation_yields_to_speed_and_memory() -> None:
    assert Options(quality="fast", saturation="always").saturation_in_effect == "always"
    for options in ({"quality": "fast"}, {"max_memory": 2**30}):
        assert Options(**options).saturation_in_effect == "ignore"
        assert replace(Options(**options), quality="best", max_memory=None).saturation_in_effect == "auto"


@pytest.mark.parametrize("quality", QUALITIES)
def test_quality_sets_mode_and_prior_unless_they_are_set(quality: Quality) -> None:
    # What was not given follows a quality that is given later.
    for first in QUALITIES:
        chosen = replace(Options(quality=first), quality=quality)
        assert chosen.prior_in_effect == QUALITIES[quality][1]
        assert chosen.mode_is_open == (QUALITIES[quality][0] == "auto")
        assert chosen.mode_is_open or chosen.mode_in_effect == QUALITIES[quality][0]
        assert chosen == Options(quality=quality)
    mode, prior = replace(Options(mode="global"), quality=quality), replace(Options(prior="tv"), quality=quality)
    assert (mode.mode_in_effect, mode.prior_in_effect) == ("global", QUALITIES[quality][1])
    assert (prior.mode_is_open, prior.prior_in_effect) == (QUALITIES[quality][0] == "auto", "tv")


def test_auto_transfer_is_srgb_for_integers_and_linear_for_floats() -> None:
    log = hand_shake(0.2, strength=0.3, seed=3)
    light = simulate(scene(120, 136), log, CAMERA, EXPOSURE).blurred.clip(0, 1)
    stored = np.rint(65535 * light).astype(np.uint16)
    options = {"prior": "wiener", "nsr": 0.02, "check": False}
    for pixels, transfer in ((light, "linear"), (stored, "srgb")):
        results = [
            deblur(pixels, log, CAMERA, EXPOSURE, **options, transfer=chosen).image for chosen in ("auto", transfer)
        ]
        np.testing.assert_array_equal(*results)


def test_simulations_of_integers_are_encoded_like_them() -> None:
    log = hand_shake(0.2, strength=0.3, seed=3)
    sharp = np.rint(255 * scene(120, 136).clip(0, 1)).astype(np.uint8)
    auto = simulate(sharp, log, CAMERA, EXPOSURE)
    as_floats = simulate(sharp.astype(np.float32) / 255, log, CAMERA, EXPOSURE, transfer="srgb")
    for picture, other in zip(auto, as_floats, strict=True):
        np.testing.assert_array_equal(picture, other)
    # Decoding and encoding again changes float32's last digits only.
    np.testing.assert_allclose(auto.rectified, sharp[20:-20, 20:-20] / np.float32(255), atol=1e-6)


def test_a_plan_is_what_deblur_does_and_serves_other_pictures() -> None:
    log = hand_shake(0.4, strength=0.3, seed=3)
    first, second = (simulate(scene(120, 136), log, CAMERA, Exposure(t, 1 / 30)).blurred for t in (0.05, 0.1))
    options = Options(prior="tv", bands=3, strips=2, weight=0.01, nsr=0.01)
    planned = plan(log, CAMERA, EXPOSURE, options)
    alone = deblur(first, log, CAMERA, EXPOSURE, prior="tv", bands=3, strips=2, weight=0.01, nsr=0.01)
    np.testing.assert_array_equal(planned.apply(first).image, alone.image)
    ready = planned.prepare(first)
    np.testing.assert_array_equal(ready.apply(first).image, alone.image)
    np.testing.assert_array_equal(ready.apply(first).psfs.kernels, alone.psfs.kernels)
    # Strengths and PSFs stay as prepared.
    again = ready.apply(second)
    assert (again.nsr, again.weight) == (alone.nsr, alone.weight)
    np.testing.assert_array_equal(again.psfs.kernels, alone.psfs.kernels)
