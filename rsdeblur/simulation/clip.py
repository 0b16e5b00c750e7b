"""Simulated clips: the frames that a shaking rolling-shutter camera records of one sharp scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.image.transfer import from_linear
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.simulation.simulate import MOST_WARPS, CameraPath, Plane, linear_scene, row_times, stored_picture
from rsdeblur.types import FloatArray


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A flat thing before the scene of a simulated clip, which moves or is nearer.

    Parameters
    ----------
    picture : array_like, shape (h, w) or (h, w, C)
        The thing where it is at the reference time, as large as the scene and with values like it.
    opacity : array_like, shape (h, w)
        From 0, where only the scene shows, to 1.
    velocity : (float, float), default (0, 0)
        (x, y) in px of the scene per second.
    depth : float, optional
        Distance in m, in the sense of :attr:`rsdeblur.Translation.depth`; without it, the thing is as far as the scene.

    Raises
    ------
    InputError
        If a value is out of its range, or the shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> disc = np.hypot(*np.mgrid[-32:32, -40:40]) < 9
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0, readout_time=0.03)
    >>> thing = rsdeblur.simulation.Layer(np.full((64, 80), 0.9), disc, velocity=(30.0, 0.0))
    >>> exposures = [rsdeblur.Exposure(0.2, 1 / 60), rsdeblur.Exposure(0.3, 1 / 60)]
    >>> one, other = rsdeblur.simulate_clip(np.full((64, 80), 0.1), log, camera, exposures, layers=[thing])
    """

    picture: ArrayLike
    opacity: ArrayLike
    velocity: tuple[float, float] = (0.0, 0.0)
    depth: float | None = None

    def __post_init__(self) -> None:
        mask = validate.array("opacity", self.opacity)
        opacity = validate.real_array("opacity", mask.astype(float) if mask.dtype == np.bool_ else mask, (None, None))
        if not (opacity.min(initial=1.0) >= 0 and opacity.max(initial=0.0) <= 1):
            raise InputError("opacity must lie from 0 to 1")
        velocity = validate.real_array("velocity", self.velocity, (2,))
        if self.depth is not None:
            object.__setattr__(self, "depth", validate.finite("depth", self.depth, above=0.0))
        object.__setattr__(self, "opacity", opacity)
        object.__setattr__(self, "velocity", (float(velocity[0]), float(velocity[1])))


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
    layers: Sequence[Layer] = (),
    transfer: Transfer | Auto = "auto",
) -> Iterator[NDArray[np.float32]]:
    """Return the frames of a clip of a sharp picture, which are simulated one by one.

    Parameters
    ----------
    sharp : array_like, shape (h, w) or (h, w, C)
        The scene half-way between the first and the last frame, as for :func:`simulate`. The camera's picture is
        centred in it; beyond its borders, the scene is mirrored.
    log, camera
        The motion and the camera.
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
    layers : sequence of Layer
        Things before the scene, the farthest first; they move, or are nearer than the scene (parallax).
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.

    Returns
    -------
    iterator of ndarray, float32
        Frames of the camera's size, not clipped, encoded like `sharp`.

    Raises
    ------
    InputError
        If an argument is out of its range, there is no exposure, or a layer has another shape than the scene, or a
        depth where no translation is given.
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
    exposures = exposure_list(exposures)
    for exposure in exposures:
        check_recording(log, camera, exposure, translation)
    layers = list(validate.items("layers", layers))
    for n, layer in enumerate(layers):
        validate.instance(f"layers[{n}]", layer, Layer)
    if not exposures:
        raise InputError("a simulated clip needs at least one exposure")
    scene, transfer = linear_scene(sharp, transfer)
    samples = validate.count("samples", samples, maximum=MOST_WARPS // camera.height)
    noise = validate.finite("noise", noise, minimum=0.0, maximum=validate.MOST_LIGHT)
    random = np.random.default_rng(validate.count("seed", seed, minimum=0))
    lights = [_premultiplied(layer, scene, transfer, translation) for layer in layers]
    frame = ReadoutFrame(camera)
    epoch = exposures[0].epoch_ns
    moved = [Exposure(e.start + 1e-9 * (e.epoch_ns - epoch), e.duration, epoch) for e in exposures]
    spans = np.array([exposure.span(frame.camera) for exposure in moved])
    span = float(spans.min()), float(spans.max())
    reference = 0.5 * sum(span)
    translation = frame.translation(translation)

    def plane(light: NDArray[np.float32], velocity: tuple[float, float], depth: float | None) -> Plane:
        places = translation if depth is None or translation is None else replace(translation, depth=depth)
        return Plane(light, CameraPath(log, frame, span, epoch, places), velocity)

    background = plane(scene, (0.0, 0.0), None)
    things = [plane(light, layer.velocity, layer.depth) for light, layer in zip(lights, layers, strict=True)]

    def frames() -> Iterator[NDArray[np.float32]]:
        for exposure in moved:
            times = row_times(*exposure.window(np.arange(frame.camera.height), frame.camera), samples)
            light = stored_picture(_seen(background, things, times, reference), frame, scene.shape[2:])
            light = light + random.normal(0.0, noise, light.shape).astype(np.float32)
            yield from_linear(light, transfer)

    return frames()


def _premultiplied(
    layer: Layer, scene: NDArray[np.float32], transfer: Transfer, translation: Translation | None
) -> NDArray[np.float32]:
    """Return the light of a layer times its opacity, and the opacity as the last channel."""
    light, _ = linear_scene(layer.picture, transfer)
    opacity = np.asarray(layer.opacity, dtype=np.float32)
    if light.shape != scene.shape or opacity.shape != scene.shape[:2]:
        raise InputError(
            f"a layer must have the scene's shape {scene.shape}, got {light.shape} and an opacity of {opacity.shape}"
        )
    if layer.depth is not None and translation is None:
        raise InputError("a layer has a depth, which only a translation shows; give one, or leave out the depth")
    return np.concatenate([np.atleast_3d(light) * opacity[..., None], opacity[..., None]], axis=-1)


def _seen(background: Plane, things: Sequence[Plane], times: FloatArray, reference: float) -> NDArray[np.float32]:
    """Return the mean light of each row at its `times` (H, T), shape (H, W, C)."""
    if not things:
        return background.seen(times, reference)
    # At each moment, things hide what is behind them; the mean of products is not the product of means.
    moments = []
    for k in range(times.shape[1]):
        at = times[:, k : k + 1]
        light = background.seen(at, reference)
        for thing in things:
            own = thing.seen(at, reference)
            light = own[..., :-1] + (1 - own[..., -1:]) * light
        moments.append(light)
    mean: NDArray[np.float32] = np.mean(moments, axis=0, dtype=np.float32)
    return mean
