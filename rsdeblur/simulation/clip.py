"""Simulated clips: the frames that a shaking rolling-shutter camera records of one sharp scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.image.transfer import from_linear
from rsdeblur.kernels.warp import average_warps
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.simulation.simulate import CameraPath, linear_scene

# Integration steps of the orientation per second. At 10 rad/s and 1000 rad/s^2, steps of 0.5 ms err by less than 1e-4
# rad over 1 s, and neighbouring frames by a thirtieth of that: a hundredth of a pixel.
STEPS_PER_SECOND = 2000


def simulate_clip(
    sharp: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    noise: float = 0.0,
    seed: int = 0,
    samples: int = 8,
    translation: Translation | None = None,
    transfer: Transfer | Auto = "auto",
) -> Iterator[NDArray[np.float32]]:
    """Yield the frames of a clip of a sharp picture.

    Parameters
    ----------
    sharp : array_like, shape (h, w) or (h, w, C)
        The scene half-way between the first and the last frame, as for :func:`simulate`. The camera's picture is
        centred in it; beyond its borders, the scene is mirrored.
    log : GyroLog
        Motion of the camera.
    camera : Camera
        The camera, without lens distortion.
    exposures : sequence of Exposure
        Time of each frame, at least one.
    noise : float, default 0.0
        Standard deviation of white Gaussian noise, in linear light of range [0, 1].
    seed : int, default 0
        Seed of the noise, at least 0.
    samples : int, default 8
        Number of warps per row, at least 1.
    translation : Translation, optional
        Positions of the camera, as for :func:`simulate`.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.

    Yields
    ------
    ndarray, float32
        A frame of the camera's size, not clipped, encoded like `sharp`.

    Raises
    ------
    InputError
        If an argument is out of its range, or the lens distorts.
    CoverageError, ClockError, GapError
        If the log or the translation does not describe the clip.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0, readout_time=0.03)
    >>> exposures = [rsdeblur.Exposure(0.2 + i / 30, 1 / 60) for i in range(3)]
    >>> sum(1 for frame in rsdeblur.simulate_clip(np.full((64, 80), 0.5), log, camera, exposures))
    3
    """
    if camera.distortion_model != "none" or not exposures:
        raise InputError("a simulated clip needs at least one exposure, and a camera without lens distortion")
    scene, transfer = linear_scene(sharp, transfer)
    samples = validate.count("samples", samples)
    noise = validate.finite("noise", noise, minimum=0.0)
    random = np.random.default_rng(validate.count("seed", seed, minimum=0))
    frame = ReadoutFrame(camera)
    upright = frame.camera
    planes = np.atleast_3d(frame.image(scene)).astype(np.float64)
    left, top = (planes.shape[1] - upright.width) // 2, (planes.shape[0] - upright.height) // 2
    coefficients = np.stack(
        [ndimage.spline_filter(planes[..., c], 3, output=np.float32, mode="mirror") for c in range(planes.shape[2])],
        axis=-1,
    )
    epoch = exposures[0].epoch_ns
    moved = [Exposure(e.start + 1e-9 * (e.epoch_ns - epoch), e.duration, epoch) for e in exposures]
    spans = np.array([exposure.span(upright) for exposure in moved])
    t0, t1 = float(spans.min()), float(spans.max())
    if translation is not None and frame.quarter:
        translation = translation.turned()
    path = CameraPath(log, upright, t0, t1, epoch, translation, steps_per_second=STEPS_PER_SECOND)
    phase = (np.arange(samples) + 0.5) / samples
    for exposure in moved:
        opens, closes = exposure.window(np.arange(upright.height), upright)
        times = opens[:, None] + (closes - opens)[:, None] * phase
        warps = path.warps(times, 0.5 * (t0 + t1), left, top)
        light = average_warps(coefficients, warps, upright.width).reshape(
            upright.height, upright.width, *scene.shape[2:]
        )
        light = frame.back(light) + random.normal(0.0, noise, frame.back(light).shape).astype(np.float32)
        yield from_linear(np.ascontiguousarray(light), transfer)
