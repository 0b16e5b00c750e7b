"""One look over all frames: what is planned once for the whole video."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.priors import brightness
from rsdeblur.errors import CoverageError, InputError, RsdeblurWarning
from rsdeblur.estimate.check import QualityCheck
from rsdeblur.image.encoded import EncodedImage, check_size
from rsdeblur.image.transfer import Transfer
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import BlurPaths, Capture, Geometry, Motion
from rsdeblur.pipeline.deblur import deblur
from rsdeblur.pipeline.settings import Mode, SolverSettings
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, Progress
from rsdeblur.video.clip import Clip, frames
from rsdeblur.video.pixels import values_of

# Frames, spread over the video, whose noise and brightness stand for all.
LOOKED_AT = 5
# Kernels at the tiles' centres may be this much larger than the probed paths say, px.
SPARE = 1


@dataclass(frozen=True, slots=True)
class Plan:
    """What all frames have in common.

    Parameters
    ----------
    method : Method
        Mode, prior and strengths.
    rows, cols : tuple of float
        Where the PSFs stand in the upright frame, px.
    size : (int, int)
        Height and width of the largest kernel, px.
    motion, geometry, transfer
        See :func:`rsdeblur.deblur`.
    """

    method: SolverSettings
    rows: tuple[float, ...]
    cols: tuple[float, ...]
    size: tuple[int, int]
    motion: Motion
    geometry: Geometry
    transfer: Transfer

    def largest(self) -> PsfBank:
        """Return a bank of this size that does nothing, to plan for."""
        kernels = np.zeros((len(self.rows), len(self.cols), *self.size), dtype=np.float32)
        kernels[:, :, self.size[0] // 2, self.size[1] // 2] = 1.0
        return PsfBank(kernels, np.array(self.rows), np.array(self.cols))


def upright_capture(log: GyroLog, camera: Camera, exposure: Exposure, motion: Motion) -> Capture:
    """Return the capture with its readout along y, as in :func:`rsdeblur.deblur`."""
    return Capture.from_log(log, camera.turned() if camera.horizontal_readout else camera, exposure, motion=motion)


def plan_clip(
    clip: Clip,
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    mode: Mode = "banded",
    transfer: Transfer = "srgb",
    geometry: Geometry = "keep",
    progress: Progress | None = None,
    **settings: Any,
) -> tuple[Plan, list[str | None]]:
    """Find the largest blur of all frames, and the strengths that suit the video.

    Warns where the motion does not explain the frames that are looked at: those results are checked.

    Parameters
    ----------
    clip, log, camera, exposures
        The video, the motion, the camera and the exposure of each frame.
    mode, transfer, geometry, **settings
        Those of :func:`rsdeblur.deblur`: bands, strips, prior, weight, exponent, nsr, solver, border, motion, planning,
        threads.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    plan : Plan
    faults : list
        Why each frame cannot be deblurred, None where it can.

    Raises
    ------
    CoverageError, ClockError, GapError
        If the log describes no frame at all.
    InputError
        If the frames are not the camera's, or the blur of every frame is too large.
    """
    check_size((clip.height, clip.width), camera)
    report_progress = progress or (lambda stage, fraction: None)
    found, reasons = _measure(clip, log, camera, exposures, settings["motion"], report_progress)
    down, across = found[:, 1:3].max(axis=0)
    size = (2 * (int(down) + 1 + SPARE) + 1, 2 * (int(across) + 1 + SPARE) + 1)
    good = found[:, 0].astype(int)
    # Frames spread over the video tell the strengths, and those with the fastest change how many tiles are needed.
    spread = good[np.unique(np.linspace(0, len(good) - 1, LOOKED_AT).astype(int))]
    looked = []
    for i in sorted({*spread.tolist(), *good[found[:, 3:].argmax(axis=0)].tolist()}):
        report_progress(f"look at frame {i}", 1.0)
        (frame,) = frames(clip, i, i + 1)
        looked.append(_alone(values_of(frame), log, camera, exposures[i], mode, transfer, settings))
    _warn_of_bad([look.check for look in looked], clip)
    nsr, peak = (float(np.median([getattr(look, name) for look in looked])) for name in ("nsr", "peak"))
    weights = [look.weight for look in looked if look.weight is not None]
    weight = float(np.median(weights)) if weights else None
    rows, cols = (max((getattr(look.psfs, axis) for look in looked), key=len) for axis in ("rows", "cols"))
    if camera.horizontal_readout:
        rows, cols = cols, (camera.height - 1 - rows)[::-1]
    own = {name: settings[name] for name in ("prior", "exponent", "solver", "border", "planning", "threads")}
    method = SolverSettings(mode=mode, nsr=nsr, weight=weight, peak=peak, **own)
    places = tuple(rows.tolist()), tuple(cols.tolist())
    return Plan(method, *places, size, settings["motion"], geometry, transfer), reasons


def _measure(
    clip: Clip, log: GyroLog, camera: Camera, exposures: Sequence[Exposure], motion: Motion, report_progress: Progress
) -> tuple[FloatArray, list[str | None]]:
    """Return number, extent along y and x and what tiles depend on, of frames that can be deblurred, and all faults."""
    measures, reasons = [], list[str | None]()
    refused: CoverageError | InputError | None = None
    for i, exposure in enumerate(exposures):
        try:
            probe = upright_capture(log, camera, exposure, motion).probe
            _check_reach(probe, camera)
        except (CoverageError, InputError) as error:
            refused = refused or error
            reasons.append(str(error))
            continue
        finally:
            report_progress("look at all frames", (i + 1) / len(exposures))
        reasons.append(None)
        measures.append((i, *probe.extent, probe.change_down, probe.curvature_down, probe.curvature_across))
    if not measures:
        raise refused or InputError(f"{clip.path}: there are no frames to deblur")
    return np.array(measures), reasons


def _check_reach(probe: BlurPaths, camera: Camera) -> None:
    """Refuse a blur that `deblur` would refuse, with the spare pixels."""
    down, across = (2 * (int(reach) + 1 + SPARE) + 1 for reach in probe.extent)
    lines, width = (camera.width, camera.height) if camera.horizontal_readout else (camera.height, camera.width)
    if down > lines or across > width:
        raise InputError(f"the blur of {across} x {down} px is larger than the picture")


class _Look(NamedTuple):
    nsr: float
    weight: float | None
    peak: float
    psfs: PsfBank
    check: QualityCheck | None


def _alone(
    values: NDArray[np.uint16],
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    mode: Mode,
    transfer: Transfer,
    settings: dict[str, Any],
) -> _Look:
    """Deblur a frame as a photo, and return what was chosen for it."""
    result = deblur(values, log, camera, exposure, mode=mode, transfer=transfer, **settings)
    peak = brightness(EncodedImage(values[::4, ::4], transfer).linear(slice(None)))
    return _Look(result.nsr, result.weight, peak, result.psfs, result.check)


def _warn_of_bad(checks: list[QualityCheck | None], clip: Clip) -> None:
    """Warn where the motion does not explain most of the frames that were looked at."""
    bad = [check for check in checks if check is not None and check.verdict == "bad"]
    if 2 * len(bad) > len(checks):
        found = f"{len(bad)} of {len(checks)} frames that were looked at come out bad"
        warnings.warn(f"{clip.path}: {found}: {' '.join(bad[0].reasons)}", RsdeblurWarning, stacklevel=2)
