"""`deblur --psf`: photos deblurred with PSFs from a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from click.testing import Result
from PIL import Image

from rsdeblur import deconvolve

if TYPE_CHECKING:
    from conftest import Files

Run = Callable[..., Result]


def test_deblur_with_an_own_kernel(run: Run, files: Files, tmp_path: Path) -> None:
    kernel, out = tmp_path / "kernel.npy", tmp_path / "sharp.png"
    np.save(kernel, np.eye(5))
    common = ["deblur", files.photo, "--psf", kernel, "--prior", "wiener"]
    checked = run(*common, "-o", out, "--dry-run")
    assert "global, PSFs of up to 5 x 5 px" in checked.stdout
    assert not out.exists()
    result = run(*common, "-o", out)
    assert result.exit_code == 0, result.stderr
    assert f"{out}: global, 1 x 1 PSFs (bands x strips) of 5 x 5 px, wiener" in result.stdout
    photo = np.asarray(Image.open(files.photo))
    expected = np.empty_like(photo)
    deconvolve(photo, np.eye(5) / 5, prior="wiener", out=expected)
    np.testing.assert_array_equal(np.asarray(Image.open(out)), expected)


def test_several_photos_with_an_own_kernel(run: Run, files: Files, tmp_path: Path) -> None:
    kernel, other = tmp_path / "kernel.npy", tmp_path / "other.png"
    np.save(kernel, np.eye(5))
    other.write_bytes(files.photo.read_bytes())
    folder = tmp_path / "new"
    call = ["deblur", files.photo, other, "--psf", kernel, "--prior", "wiener", "-o", folder]
    assert run(*call, "--dry-run").exit_code == 0
    assert not folder.exists()
    assert run(*call).exit_code == 0
    assert sorted(path.name for path in folder.iterdir()) == sorted([files.photo.name, "other.png"])
