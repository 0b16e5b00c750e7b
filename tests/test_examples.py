"""The PSF bank; representations of one line; and the examples in docstrings, which run as they are printed."""

import base64
import doctest
import inspect
import math
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rsdeblur as rs
import rsdeblur.io.pictures
from rsdeblur import Camera, Exposure, PsfBank, deconv
from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.psf import tile_centres

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
        *(rs.tuning.Tuning.of(image, BANK), rs.simulate(image, LOG, CAMERA, EXPOSURE)),
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
    for thing, names in ((BANK, ["kernels"]), (result, ["blurred", f"sharp ({result.check.verdict})", "kernels"])):
        page = thing._repr_html_()
        assert repr(thing).partition("=")[0] in page
        assert re.findall('alt="([a-z ()]+)" width="4', page) == names
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


SHUTTER = Exposure(0.1, 0.05)


def random_bank(bands=3, strips=2, height=5, width=7):
    kernels = np.random.default_rng(0).random((bands, strips, height, width))
    kernels /= kernels.sum(axis=(2, 3), keepdims=True)
    return PsfBank(kernels, np.arange(bands) * 10.0 + 2.5, np.arange(strips) * 20.0 + 1.0)


@pytest.mark.parametrize(
    ("shape", "grid"), [((3, 5), (1, 1)), ((4, 3, 5), (4, 1)), ((4, 2, 3, 5), (4, 2)), ((1, 1), (1, 1))]
)
def test_one_band_or_tiles(shape, grid):
    kernels = np.full(shape, 1 / (shape[-1] * shape[-2]))
    bank = PsfBank.for_picture(kernels, (40, 60, 3))
    kernels[:] = 7
    assert (bank.kernels.shape, bank.kernels.dtype, bank.size) == ((*grid, *shape[-2:]), np.float32, shape[-2:])
    assert bank.centres.shape == (*grid, 2)
    # The bank has its own read-only arrays.
    assert bank.kernels.max() <= 1
    assert not any(array.flags.writeable for array in (bank.kernels, bank.rows, bank.cols))


class TestFromPaths:
    @pytest.fixture
    def paths(self, shaky_log):
        capture = Capture.from_log(shaky_log(), Camera(96, 64, 90.0, readout_time=0.03), SHUTTER)
        return BlurPaths.from_capture(capture, tile_centres(4, 64), tile_centres(3, 96))

    def test_size_is_the_longest_reach_and_no_more(self, paths):
        bank = PsfBank.from_paths(paths)
        assert bank.size == tuple(2 * math.floor(reach) + 3 for reach in paths.extent)

    def test_paths_stay_with_their_kernels(self, paths, tmp_path):
        """The kernels of every bank that is made from another one are those that its paths draw."""
        bank = PsfBank.from_paths(paths)
        bank.save(tmp_path / "bank.npz")
        more = bank.padded((bank.size[0] + 4, bank.size[1] + 6))
        for other in (
            bank.cut(slice(0, 20), slice(40, 90)),
            bank.turned(96),
            PsfBank.load(tmp_path / "bank.npz"),
            more,
        ):
            drawn = PsfBank.from_paths(BlurPaths(other.displacements, other.rows, other.cols))
            # Rounded positions can move energy of 1e-9 across a grid line; entries are float32 below 1. A part of a
            # bank may have shorter paths than the whole.
            larger = tuple(max(a, b) for a, b in zip(drawn.size, other.size, strict=True))
            np.testing.assert_allclose(other.padded(larger).kernels, drawn.padded(larger).kernels, atol=2e-7)


def test_interpolates_like_the_whole():
    bank = random_bank()
    for rows, cols in ((slice(0, 40), slice(0, 50)), (slice(11, 13), slice(3, 9)), (slice(30, 40), slice(20, 50))):
        part = bank.cut(rows, cols)
        places = part.rows + rows.start, part.cols + cols.start
        for axis, (some, every, inside) in enumerate(zip(places, (bank.rows, bank.cols), (rows, cols), strict=True)):
            weights = hat_weights(every, 50)[:, inside]
            kept = hat_weights(some, 50)[:, inside]
            first = int(np.searchsorted(every, some[0]))
            np.testing.assert_array_equal(weights[first : first + len(some)], kept)
            assert not np.delete(weights, np.s_[first : first + len(some)], axis=0).any()
            assert part.kernels.shape[axis] == len(some)
        corner = np.searchsorted(bank.rows, places[0][0]), np.searchsorted(bank.cols, places[1][0])
        np.testing.assert_allclose(part.kernels[0, 0], bank.kernels[corner], rtol=3e-7)


def test_kernels_are_turned_and_moved():
    bank = random_bank()
    turned = bank.turned(50)
    # numpy.rot90 moves (y, x) to (width - 1 - x, y).
    for b, s in np.ndindex(3, 2):
        np.testing.assert_allclose(turned.kernels[1 - s, b], np.rot90(bank.kernels[b, s]), rtol=3e-7)
        assert np.array_equal(turned.centres[1 - s, b], [49 - bank.cols[s], bank.rows[b]])


class TestFile:
    def test_softness_stays_with_the_paths(self, tmp_path):
        paths = BlurPaths(np.zeros((2, 1, 5, 2)), np.array([11.0, 22.0]), np.array([14.0]), softness=0.6)
        bank = PsfBank.from_paths(paths)
        bank.save(tmp_path / "bank.npz")
        for other in (PsfBank.load(tmp_path / "bank.npz"), bank.turned(40), bank.cut(slice(0, 9), slice(0, 9))):
            assert other.softness == 0.6
        # What is drawn is cut off at three deviations.
        np.testing.assert_allclose(np.abs(np.arange(-2, 3)) ** 2 @ bank.kernels[0, 0].sum(axis=0), 0.36, rtol=0.05)


@pytest.mark.parametrize("factor", [0.45, 1.0, 1.6])
def test_a_scaled_blur_has_scaled_moments(factor: float) -> None:
    """With paths, which are scaled exactly, and without, where kernels are interpolated; its sum stays 1."""
    field = PsfBank.from_field(np.full((70, 90), 21.0), np.full((70, 90), -13.0), tile=90)
    for bank in (field, PsfBank(field.kernels, field.rows, field.cols), PsfBank.parametric(line=(20, 30), gauss=3)):
        variances = []
        for each in (bank, bank.scaled(factor)):
            kernel = each.kernels[0, 0].astype(float)
            y, x = (np.arange(n) - n // 2 for n in each.size)
            assert kernel.sum() == pytest.approx(1.0, abs=1e-6)  # float32
            assert (kernel.sum(axis=0) @ x, kernel.sum(axis=1) @ y) == pytest.approx((0.0, 0.0), abs=1e-4)
            variances.append((kernel.sum(axis=0) @ x**2, kernel.sum(axis=1) @ y**2))
        # Pixels and interpolation add up to 1 px^2.
        np.testing.assert_allclose(variances[1], factor**2 * np.array(variances[0]), atol=1.0)
        np.testing.assert_array_equal(bank.scaled(factor).rows, bank.rows)


def test_a_field_of_lines_has_no_signs() -> None:
    """A line of each pixel: its length and direction, whichever end comes first."""
    sign = np.random.default_rng(0).choice([-1, 1], (70, 90))
    bank = PsfBank.from_field(9 * sign, -4 * sign, tile=32)
    assert bank.kernels.shape[:2] == (3, 3)
    line = PsfBank.from_field(np.full((70, 90), 9), np.full((70, 90), -4), tile=90)
    # Averaged exactly but for the rounding of angles.
    np.testing.assert_allclose(bank.kernels, np.broadcast_to(line.kernels, bank.kernels.shape), atol=1e-5)
    y, x = np.nonzero(bank.kernels[0, 0] > 0.01)
    assert np.polyfit(x - x.mean(), y - y.mean(), 1)[0] == pytest.approx(-4 / 9, abs=0.05)  # pixels of a line


@pytest.mark.parametrize("line", [(0.0, 0.0), (12.3, 30.0), (7.0, -90.0)])
@pytest.mark.parametrize(("disc", "gauss"), [(5.3, 0.0), (0.0, 1.2), (4.0, 0.7), (0.0, 2.5)])
def test_a_parametric_kernel_has_the_moments_of_its_parts(line: tuple[float, float], disc: float, gauss: float) -> None:
    kernel = PsfBank.parametric(line=line, disc=disc, gauss=gauss).kernels[0, 0].astype(float)
    height, width = kernel.shape
    y, x = np.mgrid[:height, :width] - np.array([height // 2, width // 2])[:, None, None]
    cos, sin = np.cos(np.radians(line[1])), -np.sin(np.radians(line[1]))
    round_part = disc**2 / 16 + gauss**2 + 1 / 12  # and a pixel
    assert kernel.sum() == pytest.approx(1.0, abs=1e-6)  # float32
    np.testing.assert_allclose([(kernel * x).sum(), (kernel * y).sum()], 0.0, atol=1e-5)
    moments = [(kernel * each).sum() for each in (x * x, y * y, x * y)]
    variance = line[0] ** 2 / 12
    expected = [variance * cos**2 + round_part, variance * sin**2 + round_part, variance * sin * cos]
    # px^2; the rim of a disc lies between pixels.
    np.testing.assert_allclose(moments, expected, atol=0.05)
