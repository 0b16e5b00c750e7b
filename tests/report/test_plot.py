"""Plots with Matplotlib, drawn without a screen."""

import doctest

import numpy as np
import pytest

import rsdeblur as rs
from rsdeblur import Camera, Exposure, plot
from tests.installed import needs

pyplot = needs("plot")

LOG, CAMERA = rs.hand_shake(0.6, seed=1), Camera(64, 48, 80.0, readout_time=0.03, time_offset=0.1)
EXPOSURE = Exposure(0.3, 0.05)
PICTURE = np.random.default_rng(0).random((48, 64, 3))


@pytest.fixture(autouse=True)
def without_screen():
    before = pyplot.get_backend()
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")
    pyplot.switch_backend(before)


@pytest.mark.parametrize("name", ["paths", "log", "comparison"])
def test_examples_print_what_they_say(name):
    (test,) = doctest.DocTestFinder().find(getattr(plot, name), name, globs={})
    report = []
    doctest.DocTestRunner().run(test, out=report.append)
    assert not report, "".join(report)


def test_paths_start_at_their_pixel_plus_the_first_displacement():
    paths = rs.motion.BlurPaths.from_capture(rs.motion.Capture.from_log(LOG, CAMERA, EXPOSURE), [12, 36], [16, 48])
    ax = plot.paths(paths)
    zoom = float(ax.get_title().split()[-4])
    first = ax.collections[0].get_segments()[0][0]
    # The title gives two digits.
    np.testing.assert_allclose(first, [16, 12] + zoom * paths.displacements[0, 0, 0], rtol=0.05, atol=0.3)
    assert len(ax.collections) == 4


@pytest.mark.parametrize("transfer", ["srgb", "linear", 2.2])
def test_a_result_is_as_bright_as_its_photo(transfer):
    """Drawn in the same way, a photo and its result with next to no change are the same picture."""
    photo = np.rint(255 * PICTURE).astype(np.uint8)
    impulse = np.ones((1, 1))
    result = rs.deconvolve(photo, impulse, prior="wiener", nsr=1e-6, transfer=transfer)
    assert result.transfer == transfer
    drawn = [ax.images[0].get_array() for ax in plot.comparison({"blurred": photo, "sharp": result}, transfer=transfer)]
    # The filter changes light by 1e-6, and eight bits of the darkest values by less than a thousandth.
    np.testing.assert_allclose(*drawn, atol=1e-3)
    (again,) = plot.comparison({"sharp": result}, reference=result)
    np.testing.assert_array_equal(again.images[0].get_array(), drawn[1])
