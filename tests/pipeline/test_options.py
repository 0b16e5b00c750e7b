"""Options: one set of defaults for Python and the command line, and their checks."""

from __future__ import annotations

import inspect
from dataclasses import fields, replace

import click
import numpy as np
import pytest

from rsdeblur import (
    Camera,
    Exposure,
    InputError,
    Options,
    deblur,
    find_time_offset,
    plan,
    simulate,
)
from rsdeblur.choices import QUALITIES, Quality
from rsdeblur.cli.batch import command as batch
from rsdeblur.cli.deblur import command as deblur_command
from rsdeblur.cli.video import command as video
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake
from rsdeblur.video import QUALITY

DEFAULTS = {field.name: field.default for field in fields(Options)}
CAMERA, EXPOSURE = Camera(96, 80, 110.0, readout_time=0.03), Exposure(0.05, 1 / 30)


def test_the_keywords_of_deblur_are_the_options() -> None:
    keywords = {
        name: parameter.default
        for name, parameter in inspect.signature(deblur).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    }
    assert keywords == DEFAULTS | {"out": None, "progress": None}


@pytest.mark.parametrize("command", [deblur_command, batch, video])
def test_the_command_line_has_the_same_defaults(command: click.Command) -> None:
    options = {option.name: option for option in command.params if option.name in DEFAULTS}
    assert len(options) > 12
    context = click.Context(command)
    for name, option in options.items():
        # Click gives options without a default None, and flags False.
        assert option.get_default(context) == DEFAULTS[name] or DEFAULTS[name] in (None, False), name
        if isinstance(option.type, click.Choice):
            with pytest.raises(InputError, match=f"{name} must be one of {', '.join(sorted(option.type.choices))}"):
                Options(**{name: "?"})
    # The only exception, for speed.
    assert video.context_settings["default_map"] == {"quality": QUALITY}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": "rowwise", "border": "smooth"}, 'mode="rowwise" takes no border="smooth"'),
        ({"quality": "best", "border": "smooth"}, 'quality="best" takes no border="smooth"'),
        ({"fallback": True, "geometry": "rectify"}, "changes its shape"),
        ({"max_memory": 2**30, "normalize": True}, "normalize=True needs the whole picture"),
        ({"max_memory": 2**30, "border": "reflect"}, 'border="reflect" needs the whole picture'),
        ({"max_memory": 2**30, "geometry": "rectify"}, 'geometry="rectify" needs the whole picture'),
        ({"normalize": "yes"}, "normalize must be True or False"),
        ({"max_memory": 0.5}, "max_memory must be a whole number"),
        ({"exponent": 0}, "exponent must be greater than 0"),
        ({"prior": "tv", "exponent": 0.5}, "exponent belongs to prior=\"hyper-laplacian\", but prior is 'tv'"),
        ({"quality": "fast", "weight": 0.1}, 'prior="wiener" has no weight'),
        ({"softness": 1.5}, "softness must be at most 1"),
    ],
)
def test_refusals(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Options(**options)


@pytest.mark.parametrize("quality", QUALITIES)
def test_quality_sets_mode_and_prior_unless_they_are_set(quality: Quality) -> None:
    chosen = Options(quality=quality)
    assert (chosen.mode, chosen.prior) == QUALITIES[quality]
    assert Options(quality=quality, mode="global").mode == "global"
    assert Options(quality=quality, prior="nlm").prior == "nlm"
    assert replace(chosen, nsr=1.0) == Options(mode=chosen.mode, prior=chosen.prior, quality=quality, nsr=1.0)


def test_quality_is_the_same_in_python_and_on_the_command_line() -> None:
    for command in (deblur_command, batch, video):
        (option,) = (option for option in command.params if option.name == "quality")
        assert isinstance(option.type, click.Choice)
        assert option.type.choices == tuple(QUALITIES)


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
        searches = [
            find_time_offset(pixels, log, CAMERA, EXPOSURE, search=(-0.01, 0.01), transfer=chosen).scores
            for chosen in ("auto", transfer)
        ]
        np.testing.assert_array_equal(*searches)


def test_simulations_of_integers_are_encoded_like_them() -> None:
    log = hand_shake(0.2, strength=0.3, seed=3)
    sharp = np.rint(255 * scene(120, 136).clip(0, 1)).astype(np.uint8)
    auto = simulate(sharp, log, CAMERA, EXPOSURE)
    as_floats = simulate(sharp.astype(np.float32) / 255, log, CAMERA, EXPOSURE, transfer="srgb")
    for picture, other in zip(auto, as_floats, strict=True):
        np.testing.assert_array_equal(picture, other)
    # Decoding and encoding again changes float32's last digits only.
    np.testing.assert_allclose(auto.rectified, sharp[20:-20, 20:-20] / np.float32(255), atol=1e-6)
    with pytest.raises(InputError, match="sharp must be uint8, uint16 or float, got int64"):
        simulate(sharp.astype(np.int64), log, CAMERA, EXPOSURE)


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


def test_timings_contain_the_refinement() -> None:
    log = hand_shake(0.4, strength=0.3, seed=3)
    picture = simulate(scene(120, 136), log, CAMERA, EXPOSURE).blurred
    timings = deblur(picture, log, CAMERA, EXPOSURE, quality="fast", refine=True).timings
    assert list(timings)[:2] == ["refine", "tune"]
