"""PSFs and maps of depths, from NumPy files and pictures."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rsdeblur import FileFormatError
from rsdeblur.io import read_depths
from rsdeblur.io.arrays import read_psfs

METRES = np.array([[0.9, 1.2, 1.5], [2.5, 3.0, 60.0]])
SHAPE = (40, 60, 3)
WEIGHTS = np.arange(12, dtype=np.uint8).reshape(3, 4)


def saved(folder: Path, name: str, values: Any) -> Path:
    path = folder / name
    if isinstance(values, bytes):
        path.write_bytes(values)
    elif path.suffix == ".npy":
        np.save(path, values)
    else:
        Image.fromarray(values).save(path)
    return path


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("d.npy", np.float32), ("d.tiff", np.float32), *((f"d.{suffix}", np.uint16) for suffix in ("npy", "png", "tiff"))],
)
def test_floats_are_metres_and_whole_numbers_millimetres(tmp_path: Path, name: str, dtype: type) -> None:
    path = saved(tmp_path, name, ((1 if dtype == np.float32 else 1000) * METRES).astype(dtype))
    # Single precision, or whole millimetres.
    np.testing.assert_allclose(read_depths(path), METRES, rtol=1e-7)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf])
def test_an_unknown_depth_is_that_of_the_nearest_place(tmp_path: Path, unknown: float) -> None:
    path = saved(tmp_path, "depth.npy", np.array([[1.0, unknown, unknown], [1.0, unknown, 3.0]]))
    np.testing.assert_array_equal(read_depths(path)[:, [0, 2]], [[1.0, 3.0], [1.0, 3.0]])


def test_depths_of_8_bits_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"depth\.png: .*16 bits in mm"):
        read_depths(saved(tmp_path, "depth.png", np.ones((2, 3), np.uint8)))


def test_arrays_and_pictures_of_a_psf_agree(tmp_path: Path) -> None:
    expected = np.pad(WEIGHTS / WEIGHTS.sum(), ((0, 0), (0, 1)))
    rgba = np.stack([WEIGHTS, WEIGHTS, WEIGHTS, 0 * WEIGHTS], axis=-1)
    for name, values in {"k.npy": WEIGHTS, "grey.png": WEIGHTS, "rgba.png": rgba}.items():
        bank = read_psfs(saved(tmp_path, name, values), SHAPE)
        # Pictures are read in single precision.
        np.testing.assert_allclose(bank.kernels[0, 0], expected, rtol=1e-6)
        assert (bank.rows.tolist(), bank.cols.tolist()) == ([19.5], [29.5])


def test_several_psfs(tmp_path: Path) -> None:
    kernels = np.random.default_rng(0).random((2, 3, 5, 7))
    bank = read_psfs(saved(tmp_path, "k.npy", kernels), SHAPE)
    assert bank.kernels.shape == kernels.shape
    bank.save(tmp_path / "bank.npz")
    np.testing.assert_array_equal(read_psfs(tmp_path / "bank.npz", SHAPE).kernels, bank.kernels)
