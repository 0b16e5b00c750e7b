"""The recordings of the benchmarks, or what anybody has in their place.

The folder of the recordings is ``RSDEBLUR_DATA``, or ``shared/data`` beside the repository; docs/benchmarks/index.md
says where its files come from. Without that folder, pictures that scikit-image contains take the place of those, a
simulated hand's shake that of the phone's, and tables begin with :data:`NOTE`.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import skimage.data
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, GyroLog, hand_shake, psfs, read_gyro
from rsdeblur.image.transfer import to_linear
from rsdeblur.io import read_picture

Image = NDArray[np.float32]
ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("RSDEBLUR_DATA", ROOT.parent / "shared" / "data"))
RECORDED = DATA.is_dir()
# For the texts of tables: what kind of shake, and whose pictures.
REAL, COLLECTION = ("real", "Kodak") if RECORDED else ("simulated", "scikit-image")
NOTE = (
    f"Pictures of scikit-image, simulated shake: there are no recordings in {DATA}. The page's figures are of those "
    "that docs/benchmarks/index.md lists. The prior cnn has learned from some of scikit-image's pictures."
)
# Pictures of scikit-image's wheel in place of those of the folder `sharp`.
STAND_INS = {
    "kodim01": "brick.png",
    "kodim03": "coffee.png",
    "kodim05": "motorcycle_right.png",
    "kodim07": "ihc.png",
    "kodim13": "gravel.png",
    "kodim19": "rocket.jpg",
    "kodim20": "astronaut.png",
    "kodim23": "chelsea.png",
    "opensfm_berlin_01": "motorcycle_right.png",
    "imagecompression_flower_foveon_rgb8": "ihc.png",
}
# Those in place of Set12: seven of 256x256 px, then five of 512x512 px, like its own.
GREY = (
    *("camera", "chelsea", "coffee", "coins", "motorcycle_left", "clock_motion", "astronaut"),
    *("brick", "grass", "gravel", "ihc", "cell"),
)
KODAK_SIZE = 512, 768
# Simulated shake: length in s and rate in Hz, those of the phone's log.
SHAKE = 58.0, 210.0


def require_data() -> None:
    """Exit with a message if the recordings are missing, where nothing can take their place."""
    if not RECORDED:
        sys.exit(f"no recordings in {DATA}: set RSDEBLUR_DATA to their folder")


def noted(text: str) -> str:
    """Return tables, with a first line that says so if the recordings are missing."""
    return text if RECORDED else f"{NOTE}\n\n{text}"


def pages() -> Path:
    """Return the folder of the pages that benchmarks write; what is not of the recordings goes elsewhere."""
    return ROOT / "docs" / "benchmarks" if RECORDED else ROOT / "build" / "benchmarks"


def named(picture: str) -> str:
    """Return the name of the picture that :func:`pixels` returns."""
    return picture if RECORDED else STAND_INS[picture].partition(".")[0]


def pixels(picture: str) -> NDArray[Any]:
    """Return a sharp picture by its name without extension, sRGB in 8 bits, shape (H, W, 3)."""
    if RECORDED:
        (path,) = (DATA / "sharp").glob(f"{picture}.*")
        return read_picture(path).pixels
    values = read_picture(_bundled(STAND_INS[picture])).pixels
    if values.ndim == 2:
        values = np.repeat(values[..., None], 3, axis=2)
    return _fitted(values[..., :3], KODAK_SIZE) if picture.startswith("kodim") else values[..., :3]


def encoded(picture: str) -> Image:
    """Return the values of :func:`pixels` in [0, 1]."""
    return (pixels(picture) / 255).astype(np.float32)


def light(picture: str) -> Image:
    """Return the same picture in linear light."""
    return to_linear(encoded(picture), "srgb")


@cache
def shake() -> GyroLog:
    """Return the log of a phone that is shaken on purpose."""
    return read_gyro(DATA / "gyro" / "phone-210hz.txt") if RECORDED else hand_shake(SHAKE[0], rate=SHAKE[1])


def set12(number: int) -> NDArray[np.float64]:
    """Return a grey picture of Set12, numbered from 1, values in [0, 1]."""
    if RECORDED:
        return _grey(_set12_folder() / f"{number:02d}.png")
    side = 256 if number <= 7 else 512
    return _fitted(_grey(_bundled(f"{GREY[number - 1]}.png")), (side, side))


def kernels() -> list[NDArray[np.float64]]:
    """Return the eight kernels of Levin et al. (2009), or of a simulated shake, in odd sizes and with sum 1."""
    if RECORDED:
        with np.load(_set12_folder() / "levin09.npz") as archive:
            stored = [archive[name].astype(np.float64) for name in archive.files]
    else:
        exposures = (Exposure(0.5 + 0.4 * n, 1 / 20) for n in range(8))
        banks = (psfs(shake(), Camera(256, 256, 280.0), each, mode="global") for each in exposures)
        stored = [bank.kernels[0, 0].astype(np.float64) for bank in banks]
    padded = [np.pad(kernel, [(0, 1 - n % 2) for n in kernel.shape]) for kernel in stored]
    return [kernel / kernel.sum() for kernel in padded]


def _set12_folder() -> Path:
    if not (DATA / "set12" / "levin09.npz").is_file():
        sys.exit(f"skipped: no Set12 in {DATA / 'set12'}; set RSDEBLUR_DATA to the folder that contains set12/")
    return DATA / "set12"


def _bundled(name: str) -> Path:
    return Path(skimage.data.__file__).parent / name


def _grey(path: Path) -> NDArray[np.float64]:
    values: NDArray[np.float64] = read_picture(path).pixels.astype(np.float64) / 255
    return values if values.ndim == 2 else values[..., :3].mean(axis=2)


def _fitted(picture: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return the middle of a picture, mirrored where it is smaller than `size` (height, width)."""
    missing = [max(0, n - have) for n, have in zip(size, picture.shape, strict=False)]
    margins = [(n // 2, n - n // 2) for n in missing] + [(0, 0)] * (picture.ndim - 2)
    wide = np.pad(picture, margins, mode="symmetric")
    top, left = ((have - n) // 2 for n, have in zip(size, wide.shape, strict=False))
    return np.ascontiguousarray(wide[top : top + size[0], left : left + size[1]])
