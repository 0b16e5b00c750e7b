"""Fingerprints of results, to see that a change of the code changes none: ``python -m benchmarks.fingerprints``.

Every combination prints its name and short hashes: of the picture, the PSFs, the facts about the solution, the check,
or of the error's text where deblurring is refused. ``--write FILE`` stores them, ``--compare FILE`` says which of them
differ from the stored ones and exits with 1 if any does. Bits are those of one machine and its libraries: compare what
the same one wrote. All inputs are generated.
"""

from __future__ import annotations

import argparse
import atexit
import hashlib
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import av
import numpy as np
from click.testing import CliRunner
from numpy.typing import NDArray
from PIL import Image

# Stored FFT plans would change bits. Worker processes, which import this file again, inherit the folder.
if __name__ == "__main__":
    os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, os.environ["XDG_CACHE_HOME"], ignore_errors=True)

import rsdeblur as rs
from rsdeblur.cli import main as command_line
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

# Hashes by what they are of: image, psfs, facts, check; or the text of an error.
Fingerprint = dict[str, str]
Work = Callable[[], Fingerprint]
Pixels = NDArray[Any]

THREADS = 2
NOISE = 0.01
EPOCH = 7_000_000_000
# Bytes that cut the tall picture into several slabs.
NARROW, NARROWER = round(50.0 * 2**20), round(49.3 * 2**20)

# Every argument, so that a change of defaults is no change of results.
SETTINGS: dict[str, Any] = {
    "mode": "banded", "bands": "auto", "strips": "auto", "prior": "wiener", "weight": "auto", "exponent": 2 / 3,
    "nsr": "auto", "solver": "auto", "chroma": "full", "geometry": "keep", "border": "blend", "motion": "rotation",
    "translation": None,
    "transfer": "linear", "normalize": False, "saturation": "ignore", "check": True, "fallback": False,
    "planning": "estimate", "threads": THREADS, "max_memory": None,
}  # fmt: skip
MODES = ("global", "banded", "rowwise")
PRIORS = ("wiener", "gradient", "tv", "hyper-laplacian")
BORDERS = ("periodic",)
DIRECTIONS = ("bottom-up", "left-right", "right-left")


class Case(NamedTuple):
    """A call of `deblur`: a capture of `capture`, stored as `form` says, and arguments unlike `SETTINGS`."""

    name: str
    capture: str
    form: str
    settings: dict[str, Any]


# Captures, forms of storing them, and arguments, beside the products of modes and priors.
MIXED = (
    Case("small-angle", "plain", "float32", {"motion": "small-angle"}),
    Case("small-angle rowwise", "plain", "float32", {"motion": "small-angle", "mode": "rowwise"}),
    Case("bands and strips", "plain", "float32", {"bands": 5, "strips": 3, "nsr": 0.02}),
    Case("one tile", "plain", "float32", {"bands": 1, "strips": 1, "nsr": 0.02}),
    Case("weight", "plain", "float32", {"prior": "tv", "weight": 0.004, "nsr": 0.01, "strips": 2}),
    Case("exponent", "plain", "float32", {"prior": "hyper-laplacian", "exponent": 0.8}),
    Case("direct", "plain", "float32", {"mode": "rowwise", "strips": 2}),
    Case("rowwise periodic", "plain", "float32", {"mode": "rowwise", "border": "periodic"}),
    Case("tv periodic", "plain", "float32", {"prior": "tv", "border": "periodic"}),
    Case("tv unknown global", "plain", "float32", {"prior": "tv", "border": "unknown", "mode": "global"}),
    Case("normalize", "plain", "float32", {"normalize": True}),
    Case("unchecked", "plain", "float32", {"check": False}),
    Case("float64", "plain", "float64", {}),
    Case("grey", "plain", "grey", {}),
    Case("grey, one channel, rowwise", "plain", "grey1", {"mode": "rowwise", "prior": "tv"}),
    Case("grey and alpha", "plain", "grey-alpha", {"prior": "gradient"}),
    Case("RGBA", "plain", "rgba", {"transfer": "srgb"}),
    Case("RGBA tv rectify", "plain", "rgba", {"transfer": "srgb", "prior": "tv", "geometry": "rectify"}),
    Case("uint8 srgb", "plain", "uint8", {"transfer": "srgb", "prior": "tv"}),
    Case("uint8 linear", "plain", "uint8", {"transfer": "linear"}),
    Case("uint16 srgb rowwise", "plain", "uint16", {"transfer": "srgb", "mode": "rowwise"}),
    Case("uint16 2.2", "plain", "uint16", {"transfer": 2.2, "normalize": True}),
    Case("float32 out", "plain", "float32", {"out": "float32"}),
    Case("uint8 out", "plain", "uint8", {"transfer": "srgb", "out": "uint8"}),
    Case("uint16 out of uint8, turned", "left-right", "uint8", {"transfer": "srgb", "out": "uint16"}),
    Case("translation", "moved", "float32", {"translation": True}),
    Case("translation rowwise tv", "moved", "float32", {"translation": True, "mode": "rowwise", "prior": "tv"}),
    Case("translation turned", "moved left-right", "float32", {"translation": True}),
    Case("lens", "lens", "float32", {}),
    Case("lens rowwise rectify", "lens", "float32", {"mode": "rowwise", "geometry": "rectify"}),
    Case("fisheye, middle timestamp", "fisheye", "float32", {"geometry": "rectify"}),
    Case("axes and clocks", "mounted", "float32", {}),
    Case("wrong", "wrong", "float32", {"mode": "rowwise"}),
    Case("wrong, fallback", "wrong", "float32", {"fallback": True, "check": False}),
    Case("wrong, fallback, uint8 turned", "wrong left-right", "uint8", {"transfer": "srgb", "fallback": True}),
    Case("fallback of a good one", "plain", "float32", {"fallback": True}),
    Case("highlights", "lamps", "uint8", {"transfer": "srgb", "saturation": "always"}),
    Case("highlights tv", "lamps", "float32", {"saturation": "always", "prior": "tv"}),
    Case("highlights rowwise", "lamps", "float32", {"saturation": "always", "mode": "rowwise"}),
    Case("highlights turned", "lamps right-left", "float32", {"saturation": "always", "nsr": 0.02}),
    Case("highlights ignored", "lamps", "float32", {}),
    Case("highlights slabs", "tall lamps", "float32", {"saturation": "always", "nsr": 0.03, "max_memory": NARROW}),
    Case("refused: slabs and rectify", "plain", "float32", {"geometry": "rectify", "max_memory": NARROW}),
    Case("refused: rowwise and unknown", "plain", "float32", {"mode": "rowwise", "border": "unknown"}),
    Case("refused: too little memory", "plain", "float32", {"max_memory": 10**6}),
    Case("refused: fallback and rectify", "plain", "float32", {"fallback": True, "geometry": "rectify"}),
    Case("refused: beyond the log", "late", "float32", {}),
)


class Capture(NamedTuple):
    """A simulated picture in linear light, and what `deblur` takes after it."""

    light: NDArray[np.float32]
    log: rs.GyroLog
    camera: rs.Camera
    exposure: rs.Exposure
    translation: rs.Translation | None

    @property
    def recording(self) -> tuple[rs.GyroLog, rs.Camera, rs.Exposure]:
        """The log, the camera and the exposure, as most functions take them."""
        return self.log, self.camera, self.exposure


@cache
def capture(words: str) -> Capture:
    """Return the capture that `words` describe: a readout direction, and what is special about it."""
    given = words.split()
    tall = "tall" in given
    log, exposure = hand_shake(0.2, strength=0.3 if tall else 1.0, seed=3), rs.Exposure(0.05, 1 / 30)
    changes: dict[str, Any] = {"readout_direction": next((word for word in given if word in DIRECTIONS), "top-down")}
    if "lens" in given:
        changes |= {"distortion_model": "radtan", "distortion": (-0.1, 0.02, 1e-3, -1e-3)}
    if "fisheye" in given:
        changes |= {"distortion_model": "fisheye", "distortion": (0.05, -0.01, 2e-3, 0.0)}
        changes |= {"timestamp_marks": "middle"}
        exposure = replace(exposure, start=exposure.start + 0.03)
    if "mounted" in given:
        changes |= {"imu_to_camera": "phone-landscape", "time_offset": 0.004}
        exposure, log = rs.Exposure(0.05, 1 / 30, EPOCH), replace(log, epoch_ns=EPOCH)
    # Pictures through a lens take long to simulate.
    width, height = (128, 448) if tall else (160, 120) if "distortion" in changes else (256, 192)
    camera = rs.Camera(width, height, 280.0, readout_time=0.03, **changes)
    track = None
    if "moved" in given:
        t = np.linspace(-0.1, 0.5, 61)
        places = np.stack([0.02 * np.sin(9 * t), 0.015 * np.cos(7 * t), 0.05 * t], axis=-1)
        track = rs.Translation(t, places, 1.5)
    sharp = scene(camera.height + 80, camera.width + 80, seed=1)
    if "lamps" in given:
        sharp = lit(sharp)
    light = rs.simulate(sharp, log, camera, exposure, noise=NOISE, seed=2, samples="auto", translation=track).blurred
    if "lamps" in given:
        light = light.clip(0, 1)
    if "wrong" in given:
        camera = replace(camera, time_offset=camera.time_offset - 0.03)
    if "late" in given:
        exposure = replace(exposure, start=exposure.start + 60.0)
    return Capture(light, log, camera, exposure, track)


def lit(sharp: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the scene dimmed, with lamps beyond full scale in it."""
    light = 0.3 * sharp
    y, x = np.mgrid[: light.shape[0], : light.shape[1]]
    for down, across, radius, power in ((0.3, 0.3, 2.5, 10), (0.4, 0.7, 0.6, 60), (0.7, 0.5, 4.0, 4)):
        inside = np.hypot(y - round(down * light.shape[0]), x - round(across * light.shape[1])) <= radius
        light[inside] = power
    return np.asarray(light, dtype=np.float32)


def stored(light: NDArray[np.float32], form: str) -> Pixels:
    """Return the picture as `form` stores it; whole numbers and RGBA code it with a gamma."""
    coded = light.clip(0, 1) ** (1 / 2.2)
    grey = light.mean(axis=-1)
    alpha = np.linspace(0, 1, grey.size, dtype=np.float32).reshape(grey.shape)[..., None]
    forms: dict[str, Callable[[], Pixels]] = {
        "float32": lambda: light,
        "float64": lambda: light.astype(np.float64),
        "grey": lambda: grey,
        "grey1": lambda: grey[..., None],
        "grey-alpha": lambda: np.concatenate([grey[..., None], alpha], axis=-1),
        "rgba": lambda: np.concatenate([coded, alpha], axis=-1),
        "uint8": lambda: np.rint(255 * coded).astype(np.uint8),
        "uint16": lambda: np.rint(65535 * coded).astype(np.uint16),
    }
    return forms[form]()


def digest(*values: Any) -> str:
    """Return 16 hexadecimal digits of the hash of arrays, each with its type and shape, and of texts."""
    found = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            found.update(f"{value.dtype.str} {value.shape} ".encode())
            found.update(np.ascontiguousarray(value).tobytes())
        else:
            found.update(f"{value} ".encode())
    return found.hexdigest()[:16]


def arrays(bank: rs.PsfBank) -> list[Pixels]:
    """Return the kernels and their places."""
    return [bank.kernels, bank.rows, bank.cols]


def deblurred(case: Case) -> Fingerprint:
    """Return the hashes of what `deblur` makes of the case."""
    taken = capture(case.capture)
    settings = SETTINGS | case.settings
    pixels = stored(taken.light, case.form)
    if settings["translation"]:
        settings["translation"] = taken.translation
    if "out" in settings:
        settings["out"] = np.zeros(pixels.shape, settings["out"])
    result = rs.deblur(pixels, *taken.recording, **settings)
    return {
        "image": digest(result.image),
        "psfs": digest(*arrays(result.psfs)),
        "facts": digest(repr((result.bands, result.strips, result.nsr, result.weight)), result.coverage),
        "check": digest(repr(None if result.check is None else tuple(asdict(result.check).values()))),
    }


def cases() -> Iterator[Case]:
    """Yield every call of `deblur`."""
    for mode in MODES:
        for prior in PRIORS:
            yield Case(f"{mode} {prior}", "plain", "float32", {"mode": mode, "prior": prior})
        yield Case(f"{mode} rectify", "plain", "float32", {"mode": mode, "geometry": "rectify"})
        for prior, most in (("wiener", NARROW), ("wiener", NARROWER), ("tv", NARROW)):
            bound = {"mode": mode, "prior": prior, "nsr": 0.03, "max_memory": most}
            yield Case(f"{mode} {prior} slabs of {most} bytes", "tall", "float32", bound)
    for direction in DIRECTIONS:
        for mode in MODES:
            yield Case(f"{direction} {mode}", direction, "float32", {"mode": mode})
        changes = {"geometry": "rectify", "prior": "tv", "strips": 2, "transfer": "srgb"}
        yield Case(f"{direction} uint8 tv rectify", direction, "uint8", changes)
    turned = {"nsr": 0.03, "max_memory": NARROW}
    yield Case("right-left slabs", "tall right-left", "float32", turned)
    for border in BORDERS:
        yield Case(f"border {border}", "plain", "float32", {"border": border})
    yield Case("border unknown", "plain", "float32", {"border": "unknown", "prior": "tv"})
    yield from MIXED


def simulated(words: str) -> Fingerprint:
    """Return the hash of all pictures that `simulate` makes."""
    _, log, camera, exposure, track = capture(words)
    sharp = scene(camera.height + 40, camera.width + 40, seed=4)
    pictures = rs.simulate(sharp, log, camera, exposure, noise=NOISE, seed=5, samples=20, translation=track)
    return {"image": digest(*pictures)}


def kernels(words: str, **settings: Any) -> Fingerprint:
    """Return the hash of what `psfs` returns."""
    taken = capture(words)
    chosen = {name: SETTINGS[name] for name in ("mode", "bands", "strips", "motion")} | {"nsr": 0.01} | settings
    return {"psfs": digest(*arrays(rs.psfs(*taken.recording, **chosen, translation=taken.translation)))}


def offset(words: str) -> Fingerprint:
    """Return the hash of what `find_time_offset` finds."""
    taken = capture(words)
    found = rs.find_time_offset(taken.light, *taken.recording, search=(-0.05, 0.05), transfer="linear")
    answer = repr((found.time_offset, found.best, found.sd, found.reason))
    return {"facts": digest(answer, found.offsets, found.scores)}


def tiled(border: Any, prior: Any) -> Fingerprint:
    """Return the hash of a picture that the solvers of tiles make when called by themselves; no prior is Wiener's."""
    taken = capture("plain")
    bank = rs.psfs(*taken.recording, mode="banded", bands=6, strips=3, nsr=0.01, motion="rotation")
    settings: dict[str, Any] = {"border": border, "planning": "estimate", "threads": THREADS}
    if prior is None:
        return {"image": digest(rs.Deconvolver(bank, taken.light.shape, nsr=0.02, **settings).apply(taken.light))}
    height, width, channels = taken.light.shape
    solver = rs.deconv.TileQuadratic(bank, (height, width, channels), nsr=0.001, **settings)
    penalty = rs.deconv.DerivativePrior(prior, 0.003, exponent=0.7, peak=0.9)
    return {"image": digest(solver.apply(taken.light, prior=penalty))}


def row_by_row(border: Any) -> Fingerprint:
    """Return the hash of what `RowDeconvolver` makes, or without a border `RowBlur` and its adjoint."""
    taken = capture("plain")
    traced = rs.motion.Capture.from_log(*taken.recording, motion="rotation")
    paths = rs.motion.BlurPaths.every_row(traced, [60.0, 190.0], geometry="keep")
    if border is not None:
        settings: dict[str, Any] = {"nsr": 0.02, "border": border, "planning": "estimate"}
        rows = rs.deconv.RowDeconvolver(paths, taken.light.shape, **settings, threads=2)
        return {"image": digest(rows.apply(taken.light))}
    blur = rs.deconv.RowBlur(paths, taken.light.shape[1], channels=3, threads=THREADS)
    latent = blur.adjoint(taken.light)
    return {"image": digest(latent, blur.forward(latent))}


def parts() -> Iterator[tuple[str, Work]]:
    """Yield the work on the parts that `deblur` is made of."""
    for words in ("plain", "left-right", "lens", "moved"):
        yield f"simulate {words}", partial(simulated, words)
        yield f"psfs {words}", partial(kernels, words)
    yield "psfs rowwise", partial(kernels, "right-left", mode="rowwise")
    yield "psfs small-angle", partial(kernels, "bottom-up", motion="small-angle", bands=4)
    for words in ("plain", "left-right", "wrong"):
        yield f"find_time_offset {words}", partial(offset, words)
    for border in ("blend", "periodic"):
        yield f"Deconvolver {border}", partial(tiled, border, None)
        yield f"TileQuadratic {border}", partial(tiled, border, "hyper-laplacian")
    for border in ("blend", "periodic"):
        yield f"RowDeconvolver {border}", partial(row_by_row, border)
    yield "RowBlur", partial(row_by_row, None)


WIDTH, HEIGHT, FRAMES = 112, 80, 5
# What the command line tells that differs from run to run.
FLEETING = {"seconds", "timings"}


def write_inputs(folder: Path) -> None:
    """Write two photos, their true pictures, a clip, and log, cameras and manifest as a user has them."""
    log = hand_shake(0.6, strength=0.4, seed=3)
    table = np.column_stack([log.t, log.omega])
    np.savetxt(folder / "gyro.csv", table, "%.9f", ",", header="t,wx,wy,wz", comments="")
    upright = rs.Camera(WIDTH, HEIGHT, 1.1 * WIDTH, readout_time=0.02)
    upright.save(folder / "camera.toml")
    turned = replace(upright, readout_direction="right-left")
    turned.save(folder / "turned.toml")
    sharp = scene(HEIGHT + 40, WIDTH + 40, seed=1)
    for name, camera in (("clip", upright), ("turned", turned)):
        starts = [0.05 + i / 30 for i in range(FRAMES)]
        taken = [rs.simulate(sharp, log, camera, rs.Exposure(t, 1 / 30), noise=0.005, seed=6) for t in starts]
        frames = [stored(simulation.blurred, "uint8") for simulation in taken]
        write_clip(folder / f"{name}.mkv", frames)
        Image.fromarray(frames[0]).save(folder / f"{name}.png")
        Image.fromarray(stored(taken[0].rolling, "uint8")).save(folder / f"{name}-truth.png")
    lines = ["photo,start,duration,camera", "clip.png,0.05,1/30,camera.toml", "turned.png,0.05,1/30,turned.toml"]
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")


def write_clip(path: Path, frames: list[Pixels]) -> None:
    """Encode frames without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv444p"
        for i, pixels in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv444p")
            frame.pts, frame.time_base = i, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def commands() -> dict[str, list[str]]:
    """Return the command lines by name, to be called in the folder of the inputs; outputs begin with `out`."""
    sources = ["--gyro", "gyro.csv", "--camera", "camera.toml"]
    threads = ["--threads", str(THREADS)]
    upright = [*sources, "--start", "0.05", "--duration", "1/30"]
    turned = ["--gyro", "gyro.csv", "--camera", "turned.toml", *upright[4:]]
    rowwise = ["--prior", "wiener", "--mode", "rowwise"]
    film = ["--segment", "2", "--jobs", "1", *threads]
    return {
        "deblur": ["deblur", "clip.png", *upright, *threads, "-o", "out.png"],
        "deblur rowwise": ["deblur", "clip.png", *upright, *rowwise, *threads, "-o", "out.png"],
        "deblur turned": ["deblur", "turned.png", *turned, "--geometry", "rectify", *threads, "-o", "out.png"],
        "deblur beyond the log": ["deblur", "clip.png", *sources, "--start", "9", "--duration", "0.1", "-o", "out.png"],
        "batch": ["batch", "manifest.csv", "--gyro", "gyro.csv", "--jobs", "1", *threads, "-o", "out"],
        "compare": ["compare", "clip.png", *upright, *threads, "--truth", "clip-truth.png", "-o", "out"],
        "psf": ["psf", *upright, "--bank", "out.npz"],
        "psf turned": ["psf", *turned, "--mode", "rowwise", "--bank", "out.npz"],
        "psf drawn": ["psf", *upright, "--picture", "clip.png", "-o", "out.png"],
        "video": ["video", "clip.mkv", *upright, *film, "-o", "out.mkv"],
        "video tv": ["video", "clip.mkv", *upright, "--prior", "tv", "--codec", "libx264", *film, "-o", "out.mkv"],
        "video rowwise": ["video", "clip.mkv", *upright, *rowwise, *film, "-o", "out.mkv"],
        "video turned": ["video", "turned.mkv", *turned, *film, "-o", "out.mkv"],
    }


def called(arguments: list[str]) -> Fingerprint:
    """Return the hashes of what a command writes and tells."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(inputs(), folder, dirs_exist_ok=True)
        os.chdir(folder)
        try:
            result = CliRunner().invoke(command_line, [*arguments, "--json"], catch_exceptions=False)
        finally:
            os.chdir(before)
        if result.exit_code:
            return {"error": f"exit {result.exit_code}: {result.stderr}".replace(name, "FOLDER")}
        written = sorted((*folder.glob("out.*"), *folder.glob("out/*.png")))
        facts = json.dumps(lasting(json.loads(result.stdout))).replace(name, "FOLDER")
        content = [part for path in written for part in (path.name, *decoded(path))]
        return {("psfs" if "--bank" in arguments else "image"): digest(*content), "facts": digest(facts)}


@cache
def inputs() -> Path:
    """Return the folder of the command line's inputs, written once."""
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    write_inputs(folder)
    return folder


def lasting(facts: Any) -> Any:
    """Return the values, without their names, that are the same in every run."""
    if isinstance(facts, dict):
        return [lasting(value) for key, value in facts.items() if key not in FLEETING]
    return [lasting(value) for value in facts] if isinstance(facts, list) else facts


def decoded(path: Path) -> list[Pixels]:
    """Return the pixels of a picture, the frames of a video with their times, or the arrays of an archive."""
    if path.suffix == ".npz":
        return arrays(rs.PsfBank.load(path))
    if path.suffix == ".png":
        with Image.open(path) as picture:
            return [np.asarray(picture)]
    with av.open(str(path)) as container:
        frames = list(container.decode(container.streams.video[0]))
        times = [float(frame.pts * frame.time_base) for frame in frames]
        return [np.array(times), *(frame.to_ndarray() for frame in frames)]


def combinations() -> dict[str, Work]:
    """Return all work by name."""
    found: dict[str, Work] = {f"deblur: {case.name}": partial(deblurred, case) for case in cases()}
    found |= {f"part: {name}": work for name, work in parts()}
    return found | {f"command: {name}": partial(called, arguments) for name, arguments in commands().items()}


def fingerprint(work: Work) -> Fingerprint:
    """Return the hashes of what `work` makes, or the text of its error."""
    try:
        return work()
    except rs.RsdeblurError as error:
        return {"error": f"{type(error).__name__}: {error}"}


def differences(before: dict[str, Fingerprint], now: dict[str, Fingerprint]) -> Iterator[str]:
    """Yield a line for every combination that differs, with what of it does."""
    for name in sorted(before.keys() | now.keys()):
        old, new = before.get(name), now.get(name)
        if old is None or new is None:
            yield f"{name}: {'not stored' if old is None else 'gone'}"
        elif old != new:
            kinds = [kind for kind in sorted(old.keys() | new.keys()) if old.get(kind) != new.get(kind)]
            errors = [f"\n  error: {side['error']}" for side in (old, new) if "error" in side]
            yield f"{name}: {', '.join(kinds)}{''.join(errors)}"


def main() -> None:
    """Print the fingerprints; store or compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="store the fingerprints there")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="compare with the stored ones")
    parser.add_argument("--only", default="", metavar="TEXT", help="only combinations with this text in their name")
    options = parser.parse_args()
    begin = time.perf_counter()
    found: dict[str, Fingerprint] = {}
    for name, work in combinations().items():
        if options.only in name:
            found[name] = fingerprint(work)
            hashes = [f"{kind} {digest(x) if kind == 'error' else x}" for kind, x in found[name].items()]
            print(f"{name:45s} {'  '.join(hashes)}", flush=True)
    print(f"{len(found)} combinations, {time.perf_counter() - begin:.0f} s")
    if options.write:
        options.write.write_text(json.dumps(found, indent=1) + "\n")
    if options.compare:
        before: dict[str, Fingerprint] = json.loads(options.compare.read_text())
        different = list(differences({name: x for name, x in before.items() if options.only in name}, found))
        print("\n".join(different) if different else "all as stored")
        sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
