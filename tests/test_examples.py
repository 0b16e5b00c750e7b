"""Representations of one line, and the examples in docstrings, which run as they are printed."""

from __future__ import annotations

import base64
import doctest
import inspect
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rsdeblur as rs
import rsdeblur.io.pictures
from rsdeblur import Camera, Exposure, PsfBank, deconv

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
LOG, CAMERA, EXPOSURE = rs.hand_shake(0.3, seed=3), Camera(48, 36, 60.0, readout_time=0.01), Exposure(0.1, 0.025)
BANK = PsfBank.for_picture(np.eye(3)[None, None] / 3, (36, 48))
PACKAGES = (rs, rs.motion, rs.deconv, rs.estimate, rs.pipeline, rs.simulation)
PUBLIC = {name: getattr(package, name) for package in PACKAGES for name in package.__all__ if name != "__version__"}
PUBLIC["read_depths"] = rs.io.read_depths
# They read files of kinds that no example writes.
WITHOUT_EXAMPLE = {"read_captures", "read_trajectory"}


def examples(name: str) -> list[doctest.DocTest]:
    """Return the docstrings of a public name and its methods that have examples."""
    found = doctest.DocTestFinder(recurse=True).find(PUBLIC[name], name, globs={})
    return [test for test in found if test.examples]


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_examples_print_what_they_say(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tests = examples(name)
    assert tests or not inspect.isfunction(PUBLIC[name]) or name in WITHOUT_EXAMPLE, "it needs an example"
    for test in tests:
        report: list[str] = []
        doctest.DocTestRunner(optionflags=FLAGS).run(test, out=report.append)
        assert not report, "".join(report)


def test_representations_are_one_short_line() -> None:
    image = np.random.default_rng(0).random((36, 48), dtype=np.float32)
    capture = rs.motion.Capture.from_log(LOG, CAMERA, EXPOSURE)
    paths = rs.motion.BlurPaths.every_row(capture, [20.0])
    result = rs.deblur(image, LOG, CAMERA, EXPOSURE, prior="wiener")
    things = [
        *(LOG, CAMERA, EXPOSURE, capture, paths, BANK, result, result.check, rs.plan(LOG, CAMERA, EXPOSURE)),
        *(rs.Deconvolver(BANK, (36, 48)), deconv.TileQuadratic(BANK, (36, 48))),
        *(deconv.RowDeconvolver(paths, (36, 48)), deconv.RowBlur(paths, 48)),
        *(rs.estimate.Tuning.of(image, BANK), rs.simulate(image, LOG, CAMERA, EXPOSURE)),
        rs.Translation([0, 1], np.zeros((2, 3)), 1.0),
    ]
    for thing in things:
        text = repr(thing)
        assert text.startswith(type(thing).__name__ + "("), text
        assert "\n" not in text
        assert "array(" not in text
        assert " at 0x" not in text
        assert len(text) < 330
    assert "spent" not in repr(rs.plan(LOG, CAMERA, EXPOSURE)), "a field that is not to be shown"
    assert repr(Camera(48, 36, 60.0, time_offset=0.5)).endswith("imu_to_camera=float64[3, 3], time_offset=0.5)")


def test_notebooks_show_pictures_and_kernels() -> None:
    image = np.full((36, 48, 4), 200, np.uint8)
    result = rs.deblur(image, LOG, CAMERA, EXPOSURE, prior="wiener")
    for thing, names in ((BANK, ["kernels"]), (result, ["blurred", "sharp", "kernels"])):
        page = thing._repr_html_()
        assert repr(thing).partition("=")[0] in page
        assert re.findall('alt="([a-z]+)" width="4', page) == names
        uris = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
        pictures = [np.asarray(Image.open(BytesIO(base64.b64decode(uri)))) for uri in uris]
        # The input's own encoding is that of the screen; its alpha is left out.
        assert (pictures[0] == 200).all() == (len(names) == 3)


def test_the_kernel_at_a_point_is_interpolated() -> None:
    down, across = np.eye(3)[:, [1]] @ np.ones((1, 3)) / 3, np.ones((3, 1)) @ np.eye(3)[[1]] / 3
    bank = PsfBank(np.stack([down, across])[:, None], rows=[10, 30], cols=[5])
    for y, share in ((-7, 0), (10, 0), (15, 0.25), (30, 1), (99, 1)):
        # One rounding to float32 of the kernels and one of the sum.
        np.testing.assert_allclose(bank.at(y, 100), (1 - share) * down + share * across, atol=1e-7)
