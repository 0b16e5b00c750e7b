"""A camera app's photo and a log, nothing typed: ``python -m benchmarks.stock [--count N] [--wrong S] [--markdown F]``.

Each case is a photograph, shaken as a real phone was at one moment of its log and processed as by a phone. EXIF has the
exposure time, the focal length, 1 % off, and a time that is up to 0.6 s late; the readout time and the moment are
unknown. ``rsdeblur deblur IMG_1.jpg --gyro Gyroscope.csv`` gets just that, then the true camera file and moment, and at
last a log whose motion is that of another moment, which it has to refuse. The cases were written down before any was
run.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import IFD, Base
from rich.progress import track
from skimage.transform import resize

from benchmarks import data
from benchmarks.data import noted
from benchmarks.phone import NOISES, processed
from benchmarks.refine import aligned_psnr
from benchmarks.tables import markdown, report
from rsdeblur import Camera, Exposure, GyroLog, from_linear, simulate, to_linear
from rsdeblur.motion.camera_values import focal35_px

# Focal length in EXIF, mm; border of the photograph that the photo does not show, and its longest side, px.
FOCAL35, MARGIN, SIDE = 26, 48, 1152
EPOCH_NS = 1_780_000_000_000_000_000
# Moment of the log, s, from which on the wrong log has an earlier motion, and before that a later one.
MIDDLE = 30.0


@dataclass(frozen=True)
class Stock:
    """A photograph, its moment in the log, exposure and readout time, and the errors of EXIF: s, and a factor."""

    picture: str
    start: float
    duration: float
    readout: float
    late: float
    focal: float


CASES = [
    Stock("kodim05", 5.0, 1 / 15, 0.024, 0.31, 1.01),
    Stock("kodim13", 12.5, 1 / 20, 0.018, 0.12, 0.99),
    Stock("kodim20", 20.3, 1 / 25, 0.012, 0.55, 1.01),
    Stock("kodim19", 27.1, 1 / 15, 0.030, 0.41, 0.99),
    Stock("kodim23", 33.9, 1 / 30, 0.015, 0.22, 1.01),
    Stock("kodim01", 40.2, 1 / 20, 0.027, 0.60, 0.99),
    Stock("kodim03", 45.7, 1 / 15, 0.021, 0.35, 1.01),
    Stock("kodim07", 15.8, 1 / 12, 0.032, 0.18, 0.99),
    Stock("imagecompression_flower_foveon_rgb8", 23.4, 1 / 20, 0.022, 0.48, 1.01),
    Stock("opensfm_berlin_01", 37.2, 1 / 15, 0.026, 0.27, 0.99),
]


def write_case(case: Stock, number: int, folder: Path, wrong: float) -> tuple[NDArray[np.float32], Exposure]:
    """Write photo, logs, the wrong one with the motion of `wrong` s later, and camera; return truth and exposure."""
    scene = photograph(case.picture)
    width, height = ((side - 2 * MARGIN) // 4 * 4 for side in scene.shape[1::-1])
    shake = data.shake()
    log = GyroLog(shake.t - shake.t[0], shake.omega, EPOCH_NS)
    focal = case.focal * focal35_px(FOCAL35, width, height)
    camera = Camera(width, height, focal, readout_time=case.readout, imu_to_camera="phone-landscape")
    exposure = Exposure(0.0, case.duration, EPOCH_NS + round(1e9 * case.start))
    taken = simulate(scene, log, camera, exposure)
    photo = processed(taken.blurred, np.random.default_rng(number), noise=NOISES[number % len(NOISES)])
    Image.fromarray(photo).save(folder / "IMG_1.jpg", quality=95, exif=exif(case, exposure))
    camera.save(folder / "camera.toml")
    for name, later in (("Gyroscope.csv", 0.0), ("wrong.csv", wrong if case.start < MIDDLE else -wrong)):
        samples = zip((log.t - later).tolist(), log.omega.tolist(), strict=True)
        rows = [f"{EPOCH_NS + round(1e9 * s)},{s:.9f},{z:.9f},{y:.9f},{x:.9f}\n" for s, (x, y, z) in samples]
        (folder / name).write_text("".join(["time,seconds_elapsed,z,y,x\n", *rows]))
    return from_linear(taken.rolling.clip(0, 1), "srgb"), exposure


def photograph(picture: str) -> NDArray[np.float32]:
    """Return a photograph in linear light, wider than tall, at most `SIDE` px wide."""
    shown = data.encoded(picture)
    shown = np.rot90(shown) if shown.shape[0] > shown.shape[1] else shown
    size = min(1.0, SIDE / shown.shape[1])
    shape = round(size * shown.shape[0]), round(size * shown.shape[1])
    return to_linear(resize(shown, shape, anti_aliasing=size < 1).astype(np.float32), "srgb")


def exif(case: Stock, exposure: Exposure) -> bytes:
    """Return what a camera app writes; the time is that of the end of its work."""
    time, block = datetime.fromtimestamp(exposure.epoch_ns * 1e-9 + case.late, UTC), Image.Exif()
    block.get_ifd(IFD.Exif).update(
        {
            Base.DateTimeOriginal: f"{time:%Y:%m:%d %H:%M:%S}",
            Base.SubsecTimeOriginal: f"{time.microsecond // 1000:03}",
            Base.OffsetTimeOriginal: "+00:00",
            Base.ExposureTime: case.duration,
            Base.FocalLengthIn35mmFilm: FOCAL35,
        }
    )
    return block.tobytes()


def deblurred(folder: Path, truth: NDArray[np.float32], log: str, *options: str) -> str:
    """Return the PSNR (dB) and the verdict of a result of the command line, or that it was refused."""
    output = folder / "sharp.png"
    words = ["deblur", str(folder / "IMG_1.jpg"), "--gyro", str(folder / log), "--json", "--force", "-o", str(output)]
    done = subprocess.run([sys.executable, "-m", "rsdeblur", *words, *options], capture_output=True, text=True)
    if done.returncode:
        return "refused"
    facts: dict[str, Any] = json.loads(done.stdout)
    return f"{aligned_psnr(truth, shown(output)):.2f} {facts['check']['verdict']}"


def shown(path: Path) -> NDArray[np.float32]:
    """Return an encoded picture of a file in [0, 1]."""
    return np.asarray(Image.open(path), np.float32) / np.float32(255)


def row(case: Stock, number: int, wrong: float) -> list[str]:
    """Return the row of the table of one case."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth, exposure = write_case(case, number, folder, wrong)
        known = ["--camera", str(folder / "camera.toml"), "--start-ns", str(exposure.epoch_ns)]
        return [
            data.named(case.picture),
            f"{1e3 * case.readout:.0f}",
            f"{aligned_psnr(truth, shown(folder / 'IMG_1.jpg')):.2f}",
            deblurred(folder, truth, "Gyroscope.csv", *known),
            deblurred(folder, truth, "Gyroscope.csv"),
            deblurred(folder, truth, "wrong.csv"),
        ]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, help="only the first cases")
    parser.add_argument("--wrong", type=float, default=14.0, help="how much later the wrong log's motion is, s (14)")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    cases = list(enumerate(CASES[: options.count]))
    rows = [row(case, number, options.wrong) for number, case in track(cases, "deblurring")]
    columns = ("photograph", "readout, ms", "photo", "true camera and moment", "nothing typed", "wrong log")
    report(noted(markdown(columns, rows)), options.markdown)


if __name__ == "__main__":
    main()
