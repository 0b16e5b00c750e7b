"""PSFs from files: banks, arrays and pictures of a kernel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import FileFormatError, PsfBank
from rsdeblur.io.arrays import read_psfs

SHAPE = (40, 60, 3)
WEIGHTS = np.arange(12, dtype=np.uint8).reshape(3, 4)


def test_arrays_and_pictures_of_a_kernel_agree(tmp_path: Path) -> None:
    np.save(tmp_path / "k.npy", WEIGHTS)
    Image.fromarray(WEIGHTS).save(tmp_path / "grey.png")
    Image.fromarray(np.stack([WEIGHTS, WEIGHTS, WEIGHTS, 0 * WEIGHTS], axis=-1)).save(tmp_path / "rgba.png")
    expected = np.pad(WEIGHTS / WEIGHTS.sum(), ((0, 0), (0, 1)))
    for name in ("k.npy", "grey.png", "rgba.png"):
        bank = read_psfs(tmp_path / name, SHAPE)
        np.testing.assert_allclose(bank.kernels[0, 0], expected, rtol=1e-6)
        assert (bank.rows.tolist(), bank.cols.tolist()) == ([19.5], [29.5])


def test_several_psfs(tmp_path: Path) -> None:
    kernels = np.random.default_rng(0).random((2, 3, 5, 7))
    np.save(tmp_path / "k.npy", kernels)
    bank = read_psfs(tmp_path / "k.npy", SHAPE)
    assert bank.kernels.shape == kernels.shape
    bank.save(tmp_path / "bank.npz")
    np.testing.assert_array_equal(read_psfs(tmp_path / "bank.npz", SHAPE).kernels, bank.kernels)
    assert isinstance(bank, PsfBank)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.zeros((3, 3)), "the sum of a PSF must be positive"),
        (np.full((3, 3), np.nan), "values must be finite"),
        (np.ones(3), "a PSF has shape"),
        (np.array([["a"]]), "not an array of PSFs"),
        (np.array([[None]]), "not an array of PSFs"),
        (b"PK", "not a PSF bank"),
        (b"\x93NUMPY", "not an array of PSFs"),
        (b"hello", "not a JPEG, PNG"),
    ],
)
def test_refusals_name_the_file(tmp_path: Path, content: object, message: str) -> None:
    path = tmp_path / "k.npy"
    path.write_bytes(content) if isinstance(content, bytes) else np.save(path, content)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_psfs(path, SHAPE)
    assert str(path) in str(caught.value)
