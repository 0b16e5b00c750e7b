"""Maps of depths from files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsdeblur import FileFormatError
from rsdeblur.io import read_depths

METRES = np.array([[0.9, 1.2, 1.5], [2.5, 3.0, 60.0]])


def saved(folder: Path, name: str, values: np.ndarray) -> Path:
    path = folder / name
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        Image.fromarray(values).save(path)
    return path


@pytest.mark.parametrize("name", ["depth.npy", "depth.tiff"])
def test_floats_are_metres(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path, name, METRES.astype(np.float32))
    np.testing.assert_array_equal(read_depths(path), METRES.astype(np.float32))


@pytest.mark.parametrize("name", ["depth.npy", "depth.png", "depth.tiff"])
def test_whole_numbers_are_millimetres(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path, name, (1000 * METRES).astype(np.uint16))
    # Whole millimetres, in double precision.
    np.testing.assert_allclose(read_depths(path), METRES, rtol=1e-12)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf])
def test_an_unknown_depth_is_that_of_the_nearest_place(tmp_path: Path, unknown: float) -> None:
    path = saved(tmp_path, "depth.npy", np.array([[1.0, unknown, unknown], [1.0, unknown, 3.0]]))
    np.testing.assert_array_equal(read_depths(path)[:, [0, 2]], [[1.0, 3.0], [1.0, 3.0]])


FAULTS = {
    "8 bits": ("depth.png", np.ones((2, 3), np.uint8), "16 bits in mm, found uint8"),
    "colours": ("depth.npy", np.ones((2, 3, 3)), r"shape \(R, C\), found \(2, 3, 3\)"),
    "negative": ("depth.npy", -METRES, "must be positive, found -60 m"),
    "none known": ("depth.npy", np.zeros((2, 3)), "must be positive, found none"),
    "complex": ("depth.npy", np.ones((2, 3), complex), "found complex128"),
}


@pytest.mark.parametrize(("name", "values", "message"), FAULTS.values(), ids=FAULTS)
def test_faults(tmp_path: Path, name: str, values: np.ndarray, message: str) -> None:
    path = saved(tmp_path, name, values)
    with pytest.raises(FileFormatError, match=rf"depth\.{path.suffix[1:]}: .*{message}"):
        read_depths(path)


def test_a_damaged_array(tmp_path: Path) -> None:
    path = tmp_path / "depth.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00nonsense")
    with pytest.raises(FileFormatError, match="not an array of depth maps"):
        read_depths(path)
