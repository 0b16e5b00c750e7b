"""Laws of the PSF bank: checks, rasterised paths, turning and files."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.errors import FileFormatError
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank, tile_centres

EXPOSURE = Exposure(0.1, 0.05)


def random_bank(bands=3, strips=2, height=5, width=7):
    kernels = np.random.default_rng(0).random((bands, strips, height, width))
    kernels /= kernels.sum(axis=(2, 3), keepdims=True)
    return PsfBank(kernels, np.arange(bands) * 10.0 + 2.5, np.arange(strips) * 20.0 + 1.0)


def assert_same(a, b):
    for name in ("kernels", "rows", "cols"):
        # A bank normalises kernels again, which are already normalised up to float32 rounding.
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=3e-7, atol=1e-12, err_msg=name)


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
        capture = Capture.from_log(shaky_log(), Camera(96, 64, 90.0, readout_time=0.03), EXPOSURE)
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
        for axis, (some, every, inside) in enumerate(((part.rows, bank.rows, rows), (part.cols, bank.cols, cols))):
            weights = hat_weights(every, 50)[:, inside]
            kept = hat_weights(some, 50)[:, inside]
            first = int(np.searchsorted(every, some[0]))
            np.testing.assert_array_equal(weights[first : first + len(some)], kept)
            assert not np.delete(weights, np.s_[first : first + len(some)], axis=0).any()
            assert part.kernels.shape[axis] == len(some)
        corner = np.searchsorted(bank.rows, part.rows[0]), np.searchsorted(bank.cols, part.cols[0])
        np.testing.assert_allclose(part.kernels[0, 0], bank.kernels[corner], rtol=3e-7)


def test_kernels_are_turned_and_moved():
    bank = random_bank()
    turned = bank.turned(50)
    # numpy.rot90 moves (y, x) to (width - 1 - x, y).
    for b, s in np.ndindex(3, 2):
        np.testing.assert_allclose(turned.kernels[1 - s, b], np.rot90(bank.kernels[b, s]), rtol=3e-7)
        assert np.array_equal(turned.centres[1 - s, b], [49 - bank.cols[s], bank.rows[b]])


class TestFile:
    def test_round_trip(self, tmp_path):
        bank = random_bank()
        bank.save(tmp_path / "bank.npz")
        assert_same(PsfBank.load(tmp_path / "bank.npz"), bank)

    def test_softness_stays_with_the_paths(self, tmp_path):
        paths = BlurPaths(np.zeros((2, 1, 5, 2)), np.array([11.0, 22.0]), np.array([14.0]), softness=0.6)
        bank = PsfBank.from_paths(paths)
        bank.save(tmp_path / "bank.npz")
        for other in (PsfBank.load(tmp_path / "bank.npz"), bank.turned(40), bank.cut(slice(0, 9), slice(0, 9))):
            assert other.softness == 0.6
        # What is drawn is cut off at three deviations.
        np.testing.assert_allclose(np.abs(np.arange(-2, 3)) ** 2 @ bank.kernels[0, 0].sum(axis=0), 0.36, rtol=0.05)

    def test_bad_files_are_named(self, tmp_path):
        bank = random_bank()
        (tmp_path / "text.npz").write_text("not a bank")
        np.savez(tmp_path / "lacks.npz", kernels=bank.kernels, rows=bank.rows)
        np.savez(tmp_path / "unlike.npz", kernels=bank.kernels, rows=bank.rows, cols=bank.rows)
        names = ("text.npz", "lacks.npz", "unlike.npz")
        for path in (tmp_path / name for name in names):
            with pytest.raises(FileFormatError, match=f"^{path}: not a PSF bank"):
                PsfBank.load(path)
        for path in (tmp_path / "none.npz", tmp_path):
            with pytest.raises(FileFormatError, match="cannot read the PSF bank: "):
                PsfBank.load(path)


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
