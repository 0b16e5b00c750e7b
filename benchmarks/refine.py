"""How well `refine` corrects wrong recordings of simulated captures that a phone has processed.

``python -m benchmarks.refine [--photos N] [--captures N] [--right N] [--without PART] [--records FILE] [--markdown
FILE]``. With ``--photos 6`` each recording has six photos, which are refined together. ``--without`` leaves a part of
`refine` out, to show what it is worth. Each row is appended to --records as soon as it is measured; rows that the file
has are not measured again. The constants of `refine` were chosen on the same photographs at other moments of the log,
with other seeds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import data
from benchmarks.captures import BORDER
from benchmarks.data import Image, noted
from benchmarks.phone import processed
from benchmarks.tables import append, markdown, recorded, report
from rsdeblur import Camera, Correction, Exposure, GyroLog, RsdeblurError, deblur, refine, simulate
from rsdeblur.estimate import refine as refining
from rsdeblur.estimate.correction import Recording, uncertainty_of
from rsdeblur.estimate.regions import DriftByRegion, with_factors
from rsdeblur.estimate.streaks import LightStreaks
from rsdeblur.image.transfer import from_linear
from rsdeblur.motion.axes import rotations
from rsdeblur.motion.camera import UNKNOWN_READOUT
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.simulation import Simulation

PICTURES = ("kodim01", "kodim03", "kodim05", "kodim07", "kodim13", "kodim19", "kodim20", "kodim23")
KINDS = ("none", "offset", "readout", "scale", "bias", "drift", "all", "axes", "depths", "unknown", "bent")
# Those of a whole recording: drifts differ from photo to photo.
SHARED_KINDS = ("none", "offset", "readout", "scale", "all", "axes", "unknown", "drifts")
# Focal length of recordings whose photos have drifts of their own, as a factor.
DRIFTS_SCALE = 1.2
# Parts of `refine` that can be left out, and what then takes their place.
PARTS = {
    "regions": (DriftByRegion, "best", lambda *_, **__: None),
    "rivals": (refining, "rival_lead", lambda *_: -np.inf),
    "streaks": (LightStreaks, "nats", lambda *_: 0.0),
    "acceleration": (refining, "uncertainty_of", lambda *given: replace(uncertainty_of(*given), acceleration=0.0)),
}
# Exposure that shows an acceleration, s.
LONG = 0.2
# Mean length of the paths that are used, px.
LENGTHS = 4.0, 35.0
# Softness of the pictures that are aligned, px, and the steps that this takes.
SOFT, STEPS = 2.0, 5
# Softness of the border between two depths, and the distance of the places of the true map, px.
BORDER_SOFTNESS, MAP_STEP = 40.0, 16


@dataclass(frozen=True, eq=False)
class Case:
    """A capture: the scene in linear light, the true recording, and what the noise depends on."""

    name: str
    scene: Image
    true: Recording
    number: int

    @cached_property
    def simulation(self) -> Simulation:
        """The blurred and the sharp picture, linear light."""
        true = self.true
        return simulate(self.scene, true.log, true.camera, true.exposure, translation=true.translation)

    @cached_property
    def picture(self) -> NDArray[np.uint8]:
        """The picture that the phone stores."""
        random = np.random.default_rng(self.number)
        return processed(self.simulation.blurred, random, noise=(0.004, 0.01, 0.02)[self.number % 3])


@dataclass(frozen=True, eq=False)
class Depths(Case):
    """A capture of things at two depths, which drift differently; the border between them is soft."""

    drift: Correction
    near: float
    """How much further the nearer things drift."""
    share: Image
    """Share of the nearer things, shape (H, W, 1)."""

    @classmethod
    def of(cls, case: Case, random: np.random.Generator) -> Depths:
        """Return a capture with random drifts and a random border through its middle."""
        (height, width, _), turn = case.scene.shape, random.uniform(0, 2 * np.pi)
        length, near = random.uniform(2, 4) * width / 640, random.uniform(2, 4)
        drift = Correction(drift_x=float(length * np.cos(turn)), drift_y=float(length * np.sin(turn)))
        side = random.uniform(0, 2 * np.pi)
        y, x = np.mgrid[:height, :width]
        beyond = (x - width / 2) * np.cos(side) + (y - height / 2) * np.sin(side)
        share = (1 / (1 + np.exp(-beyond / BORDER_SOFTNESS))).astype(np.float32)[..., None]
        return cls(case.name, case.scene, case.true, case.number, drift, near, share)

    @cached_property
    def simulation(self) -> Simulation:
        """The pictures of both depths, blended."""
        drifts = [
            replace(self.drift, **{name: size * getattr(self.drift, name) for name in ("drift_x", "drift_y")})
            for size in (1.0, self.near)
        ]
        moved = [self.true.corrected(drift) for drift in drifts]
        far, near = (
            simulate(self.scene, each.log, each.camera, each.exposure, translation=each.translation) for each in moved
        )
        return Simulation(*(a + self.share * (b - a) for a, b in zip(far, near, strict=True)))

    @property
    def known(self) -> Recording:
        """The recording with the true map of depths."""
        factors = 1 + (self.near - 1) * self.share[::MAP_STEP, ::MAP_STEP, 0].astype(np.float64)
        centres = [(np.arange(count) + 0.5) / count for count in factors.shape]
        return with_factors(self.true, self.drift, factors, (centres[0], centres[1]))


@dataclass(frozen=True)
class Row:
    """What refinement did to one recording with one error: errors of the paths in px, PSNR in dB, means of photos."""

    seed: int
    capture: int
    kind: str
    accepted: bool
    seconds: float
    given_px: float
    refined_px: float
    given: float
    refined: float
    true: float
    photos: int = 1


def recordings(count: int, seed: int, photos: int) -> Iterator[list[Case]]:
    """Simulate the photos of some recordings."""
    if photos == 1:
        yield from ([case] for case in cases(count, seed))
    else:
        yield from (taken(photos, seed, number) for number in range(count))


def taken(photos: int, seed: int, number: int) -> list[Case]:
    """Simulate several photos of one recording, each of another scene, at random moments of the log."""
    log, random = data.shake(), np.random.default_rng((seed, number))
    scenes = [landscape(name) for name in random.choice(PICTURES, photos, replace=False)]
    height, width, _ = scenes[0].shape
    readout_time, duration = random.choice([0.01, 0.02, 0.03]), random.choice([1 / 30, 1 / 20, 1 / 15])
    camera = Camera(width, height, width * random.uniform(0.75, 1.1), readout_time=float(readout_time))
    found: list[Case] = []
    while len(found) < photos:
        exposure = Exposure(random.uniform(2, 55), float(duration), log.epoch_ns)
        if usable(recording := Recording(log, camera, exposure)):
            n = len(found)
            found.append(Case(f"{number}-{n}", scenes[n], recording, photos * number + n))
    return found


def usable(recording: Recording) -> bool:
    """Return whether the log describes the exposure, and the blur has a length that is used."""
    try:
        return bool(LENGTHS[0] < recording.capture().probe.lengths.mean() < LENGTHS[1])
    except RsdeblurError:
        return False


def cases(count: int, seed: int) -> Iterator[Case]:
    """Simulate captures from photographs and a real phone's shake, at random times of its log."""
    log = data.shake()
    random = np.random.default_rng(seed)
    for n in range(count):
        name = PICTURES[n % len(PICTURES)]
        scene = landscape(name)
        recording = moment(log, scene, [1 / 30, 1 / 20, 1 / 15, 1 / 10], random)
        yield Case(f"{data.named(name)} {recording.exposure.start:.1f} s", scene, recording, n)


def moment(log: GyroLog, scene: Image, durations: Sequence[float], random: np.random.Generator) -> Recording:
    """Return a recording of a scene at a random moment that can be used, with one of some exposures, s."""
    height, width, _ = scene.shape
    while True:
        readout_time, duration = random.choice([0.01, 0.02, 0.03]), random.choice(durations)
        camera = Camera(width, height, width * random.uniform(0.75, 1.1), readout_time=float(readout_time))
        exposure = Exposure(random.uniform(2, 55), float(duration), log.epoch_ns)
        if usable(recording := Recording(log, camera, exposure)):
            return recording


def landscape(name: str) -> Image:
    """Return a picture in linear light, wider than tall."""
    light = data.light(name)
    return np.ascontiguousarray(np.rot90(light)) if light.shape[0] > light.shape[1] else light


def error(kind: str, random: np.random.Generator, recording: Recording) -> Correction:
    """Return a random error of one kind."""
    camera, duration = recording.camera, recording.exposure.duration
    sign = random.choice([-1, 1])
    if kind == "offset":
        return Correction(offset=float(sign * random.uniform(5e-3, 20e-3)))
    if kind == "readout":
        return Correction(readout=float(np.log(random.choice([0.7, 0.85, 1.2, 1.4]))))
    if kind == "scale":
        return Correction(scale=float(np.log(random.choice([0.85, 0.93, 1.07, 1.15]))))
    if kind == "bias":
        bias = random.normal(size=3)
        bias *= random.uniform(0.01, 0.03) / np.linalg.norm(bias)
        px = camera.focal_length[0] * duration
        return Correction(drift_x=float(bias[1] * px), drift_y=float(bias[0] * px), roll=float(bias[2]))
    if kind == "drift":
        turn, length = random.uniform(0, 2 * np.pi), random.uniform(3, 8) * camera.width / 640
        return Correction(drift_x=float(length * np.cos(turn)), drift_y=float(length * np.sin(turn)))
    if kind == "bent":
        # Middle of the path, px from its chord, and the drift along it.
        sizes = random.uniform((2, 0.5), (5, 1.5)) * camera.width / 640 * (1, 8 / duration**2)
        turns = random.uniform(0, 2 * np.pi, 2)
        (drift_x, acceleration_x), (drift_y, acceleration_y) = sizes * np.cos(turns), sizes * np.sin(turns)
        return Correction(
            drift_x=float(drift_x),
            drift_y=float(drift_y),
            acceleration_x=float(acceleration_x),
            acceleration_y=float(acceleration_y),
        )
    if kind == "all":
        drift = random.uniform(-3, 3, 2) * camera.width / 640
        return Correction(
            scale=random.uniform(-0.1, 0.1),
            drift_x=float(drift[0]),
            drift_y=float(drift[1]),
            offset=float(sign * random.uniform(3e-3, 10e-3)),
            readout=random.uniform(-0.2, 0.2),
            roll=random.uniform(-0.02, 0.02),
        )
    return Correction()


def mounted(random: np.random.Generator, recording: Recording) -> Recording:
    """Return a recording with another mounting of the gyro."""
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    camera = recording.camera
    return replace(recording, camera=replace(camera, imu_to_camera=random.choice(turns) @ camera.imu_to_camera))


def paths(recording: Recording) -> NDArray[np.float64]:
    """Return the paths at 9 x 5 places, each about its mean."""
    capture = recording.capture()
    rows, cols = (np.linspace(0, n - 1, m) for n, m in ((capture.camera.height, 9), (capture.camera.width, 5)))
    displacements = BlurPaths.from_capture(capture, rows, cols, samples=65).displacements
    return np.asarray(displacements - displacements.mean(axis=2, keepdims=True))


def distance(recording: Recording, other: Recording) -> float:
    """Return the root mean square distance of the paths, px."""
    return float(np.sqrt(np.square(paths(recording) - paths(other)).sum(axis=-1).mean()))


def aligned_psnr(truth: Image, image: Image) -> float:
    """Return the PSNR (dB) of a picture in sRGB, without the border, aligned with the truth."""
    y, x = np.indices(truth.shape[:2], dtype=np.float64)
    u, v = (2 * axis / axis.max() - 1 for axis in (x, y))
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    soft, softer = (ndimage.gaussian_filter(each.mean(axis=2), SOFT) for each in (truth, image))
    slopes = np.gradient(softer)
    inside = np.s_[..., BORDER:-BORDER, BORDER:-BORDER]
    numbers = np.zeros((2, len(basis)))
    for _ in range(STEPS):
        places = np.stack([y, x]) + np.tensordot(numbers, basis, 1)
        jacobian = np.concatenate([ndimage.map_coordinates(slope, places, order=1) * basis for slope in slopes])
        residual = soft - ndimage.map_coordinates(softer, places, order=3)
        columns = jacobian[inside].reshape(len(jacobian), -1)
        numbers += np.linalg.lstsq(columns @ columns.T, columns @ residual[inside].ravel())[0].reshape(numbers.shape)
    places = np.stack([y, x]) + np.tensordot(numbers, basis, 1)
    shown = np.stack([ndimage.map_coordinates(part, places, order=3) for part in np.moveaxis(image, -1, 0)], axis=-1)
    crop = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return float(peak_signal_noise_ratio(truth[crop], shown[crop].clip(0, 1), data_range=1.0))


@lru_cache(maxsize=32)
def psnr(case: Case, recording: Recording) -> float:
    """Return the PSNR (dB) of a capture deblurred with a recording."""
    parts = recording.log, recording.camera, recording.exposure
    result = deblur(case.picture, *parts, translation=recording.translation, saturation="ignore", check=False)
    return aligned_psnr(from_linear(case.simulation.rolling.clip(0, 1), "srgb"), result.image)


def given_wrongly(photos: Sequence[Case], kind: str, random: np.random.Generator) -> list[Recording]:
    """Return the recordings of photos with one error; several photos have no drift in common."""
    first = photos[0].true
    if kind in ("axes", "unknown"):
        camera = mounted(random, first).camera if kind == "axes" else replace(first.camera, **UNKNOWN_READOUT)
        return [replace(photo.true, camera=camera) for photo in photos]
    if kind == "drifts":
        photos = [replace(photo, true=replace(photo.true, translation=None)) for photo in photos]
    wrong = Correction(scale=np.log(DRIFTS_SCALE)) if kind == "drifts" else error(kind, random, first)
    if len(photos) > 1:
        wrong = replace(wrong, drift_x=0.0, drift_y=0.0)
    return [photo.true.corrected(wrong) for photo in photos]


def measured(photos: list[Case], capture: int, kind: str, seed: int) -> Row | None:
    """Return what refinement does to a recording with an error; None where the log does not describe all photos."""
    kinds = KINDS if len(photos) == 1 else SHARED_KINDS
    random = np.random.default_rng((seed, capture, kinds.index(kind)))
    if kind == "depths":
        photos = [Depths.of(photos[0], random)]
    if kind == "bent":
        photos = [replace(photo, true=moment(photo.true.log, photo.scene, [LONG], random)) for photo in photos]
    if kind == "drifts":
        photos = [replace(photo, true=photo.true.corrected(error("drift", random, photo.true))) for photo in photos]
    true = [photo.known if isinstance(photo, Depths) else photo.true for photo in photos]
    try:
        given = given_wrongly(photos, kind, random)
        given_px = mean_distance(given, true)
    except RsdeblurError:
        return None
    shared = given[0].log, given[0].camera, [each.exposure for each in given]
    begin = time.perf_counter()
    # An acceleration is searched where an accelerometer confirms the axes.
    pictures, known = [photo.picture for photo in photos], kind == "bent"
    found = refine(pictures, *shared, translation=given[0].translation, known_axes=known)
    seconds = time.perf_counter() - begin
    refined = [Recording(each.log, each.camera, each.exposure, each.translation) for each in found]
    return Row(
        seed,
        capture,
        kind,
        found[0].accepted,
        seconds,
        given_px,
        mean_distance(refined, true),
        given=mean_psnr(photos, given),
        refined=mean_psnr(photos, refined),
        true=mean_psnr(photos, true),
        photos=len(photos),
    )


def mean_distance(given: Sequence[Recording], true: Sequence[Recording]) -> float:
    """Return the mean distance of the paths of photos from the true ones, px."""
    return float(np.mean([distance(a, b) for a, b in zip(given, true, strict=True)]))


def mean_psnr(photos: Sequence[Case], given: Sequence[Recording]) -> float:
    """Return the mean PSNR (dB) of photos deblurred with their recordings."""
    return float(np.mean([psnr(photo, recording) for photo, recording in zip(photos, given, strict=True)]))


def table(rows: list[Row]) -> str:
    """Return the means of each kind of error."""
    lines = []
    for kind in dict.fromkeys((*KINDS, *SHARED_KINDS)):
        group = [row for row in rows if row.kind == kind]
        if not group:
            continue
        means = {
            name: float(np.mean([getattr(row, name) for row in group]))
            for name in Row.__annotations__
            if name != "kind"
        }
        lost = means["true"] - means["given"]
        recovered = "-" if kind in ("none", "axes") else f"{(means['refined'] - means['given']) / lost:.0%}"
        worst = max(row.given - row.refined for row in group)
        lines.append(
            (
                "none: the recording is right" if kind == "none" else kind,
                f"{len(group)}",
                f"{sum(row.accepted for row in group)}",
                f"{means['given_px']:.2f} -> {means['refined_px']:.2f}",
                f"{lost:.2f}",
                f"{means['true'] - means['refined']:.2f}",
                recovered,
                f"{max(worst, 0.0):.2f}",
            )
        )
    return markdown(("error", "recordings", "accepted", "px", "dB lost", "left", "recovered", "worst"), lines)


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=1, help="photos of each recording, up to 8")
    parser.add_argument("--captures", type=int, default=15, help="recordings with every kind of error")
    parser.add_argument("--right", type=int, default=30, help="recordings that are right")
    parser.add_argument("--kinds", help="kinds of errors to measure, separated by commas (all)")
    parser.add_argument("--without", choices=PARTS, help="part of `refine` to leave out; needs records of its own")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    kinds = options.kinds.split(",") if options.kinds else KINDS if options.photos == 1 else SHARED_KINDS
    known = (Row(**each) for each in recorded(options.records))
    rows = {(row.capture, row.kind): row for row in known if (row.seed, row.photos) == (options.seed, options.photos)}
    count = max(options.captures, options.right)
    for n, photos in enumerate(recordings(count, options.seed, options.photos)):
        for kind in kinds:
            if (n, kind) in rows or n >= (options.right if kind == "none" else options.captures):
                continue
            with patch.object(*PARTS[options.without]) if options.without else nullcontext():
                row = measured(photos, n, kind, options.seed)
            if row is None:
                continue
            rows[n, kind] = row
            print(f"{photos[0].name}, {kind}: {row}", flush=True)
            append(options.records, asdict(row))
    report(noted(table(list(rows.values()))), options.markdown)


if __name__ == "__main__":
    main()
