"""Forward model: the pictures and clips that a shaking rolling-shutter camera records of a sharp scene.

Each row is the average of the scene warped at many times. The model shares only the lens with the paths and PSFs, not
even the integration of the rates, so that an error in one is visible against the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation, Slerp

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import ReadoutFrame
from rsdeblur.image.transfer import as_float, from_linear, resolve_transfer, to_linear
from rsdeblur.kernels.resample import average_warps
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Integration steps of the orientation per second. At 10 rad/s and 1000 rad/s^2, the midpoint rule with steps of 50 us
# errs by less than 1e-7 rad over 0.1 s, far below a hundredth of a pixel.
STEPS_PER_SECOND = 20_000

# Most warps of a simulation: some 10 GB with their products.
MOST_WARPS = 20_000_000


@one_line()
class Simulation(NamedTuple):
    """Result of :func:`simulate`; all pictures are float32 and have the size of the camera's picture.

    Parameters
    ----------
    blurred : ndarray
        The recorded picture, with noise.
    rectified : ndarray
        The sharp scene at the mid-exposure of the middle row: the ideal result for ``geometry="rectify"``.
    rolling : ndarray
        The sharp scene, each row at its own mid-exposure: the ideal result for ``geometry="keep"``.
    """

    blurred: NDArray[np.float32]
    rectified: NDArray[np.float32]
    rolling: NDArray[np.float32]


def simulate(
    sharp: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    noise: float = 0.0,
    seed: int = 0,
    samples: int | Literal["auto"] = "auto",
    translation: Translation | None = None,
    transfer: Transfer | Auto = "auto",
) -> Simulation:
    """Return a sharp picture blurred as a rolling-shutter camera with this motion would record it.

    Parameters
    ----------
    sharp : array_like, shape (h, w) or (h, w, C)
        The scene at the mid-exposure of the middle row: uint8, uint16 or floats in [0, 1]. It is at least as large as
        the camera's picture, which is centred in it, and mirrored beyond its borders.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    noise : float, default 0.0
        Standard deviation of white Gaussian noise, in linear light of range [0, 1]; 0.01 is 40 dB.
    seed : int, default 0
        Seed of the noise, at least 0.
    samples : int or "auto"
        Number of warps per row, at least 1; "auto" takes at least 2 per pixel of the longest path.
    translation : Translation, optional
        Positions of the camera. The scene is then a plane at one `translation.depth`, perpendicular to the optical axis
        at the mid-exposure of the middle row.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`: "auto" is sRGB for integers and linear for floats.

    Returns
    -------
    Simulation
        ``(blurred, rectified, rolling)``, float32, not clipped, encoded like `sharp`.

    Raises
    ------
    InputError
        If an argument is out of its range, or `sharp` is smaller than the camera's picture or not finite.
    CoverageError, ClockError, GapError
        If the log or the translation does not describe the exposure.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0, readout_time=0.03)
    >>> rsdeblur.simulate(np.full((64, 80, 3), 0.5), log, camera, rsdeblur.Exposure(0.2, 0.05))
    Simulation(blurred=float32[48, 64, 3], rectified=float32[48, 64, 3], rolling=float32[48, 64, 3])
    """
    stage = _Stage(sharp, log, camera, [exposure], translation, transfer, noise, seed)
    height, width = stage.scene.shape[:2]
    if height < camera.height or width < camera.width:
        raise InputError(
            f"sharp must be at least as large as the camera's picture, {camera.width}x{camera.height}, "
            f"got {width}x{height}"
        )
    if validate.is_auto(samples):
        # Steps of half a pixel alias at 2 cycles/px, four times the highest frequency of a picture.
        count = max(16, int(np.ceil(2 * stage.path.longest(*stage.windows[0]))))
    else:
        count = validate.count("samples", samples, maximum=MOST_WARPS)
    blurred, rolling = stage.recorded(0, count), stage.light(0, 1)
    left, top = stage.corner
    rectified = np.ascontiguousarray(stage.scene[top : top + camera.height, left : left + camera.width])
    return Simulation(*(from_linear(picture, stage.transfer) for picture in (blurred, rectified, rolling)))


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
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.

    Returns
    -------
    iterator of ndarray, float32
        Frames of the camera's size, not clipped, encoded like `sharp`.

    Raises
    ------
    InputError
        If an argument is out of its range, or there is no exposure.
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
    if not exposures:
        raise InputError("a simulated clip needs at least one exposure")
    stage = _Stage(sharp, log, camera, exposures, translation, transfer, noise, seed)
    samples = validate.count("samples", samples, maximum=MOST_WARPS // camera.height)
    return (from_linear(stage.recorded(n, samples), stage.transfer) for n in range(len(exposures)))


class _Stage:
    """A scene, and the camera that records it in several exposures."""

    def __init__(
        self,
        sharp: ArrayLike,
        log: GyroLog,
        camera: Camera,
        exposures: Sequence[Exposure],
        translation: Translation | None,
        transfer: Transfer | Auto,
        noise: float,
        seed: int,
    ) -> None:
        for exposure in exposures:
            check_recording(log, camera, exposure, translation)
        self.scene, self.transfer = _linear_scene(sharp, transfer)
        self._noise = validate.finite("noise", noise, minimum=0.0, maximum=validate.MOST_LIGHT)
        self._random = np.random.default_rng(validate.count("seed", seed, minimum=0))
        self._frame = ReadoutFrame(camera)
        rows, epoch = np.arange(self._frame.camera.height), exposures[0].epoch_ns
        moved = [Exposure(e.start + 1e-9 * (e.epoch_ns - epoch), e.duration, epoch) for e in exposures]
        self.windows = [exposure.window(rows, self._frame.camera) for exposure in moved]
        span = float(np.min(self.windows)), float(np.max(self.windows))
        self._reference = 0.5 * sum(span)
        self.path = CameraPath(log, self._frame, span, epoch, self._frame.translation(translation))
        stored, (height, width) = self._frame.stored, self.scene.shape[:2]
        #: Column and row of the picture's corner in the scene as stored, at the reference time.
        self.corner = left, top = (width - stored.width) // 2, (height - stored.height) // 2
        self._corner = (height - stored.height - top, left) if self._frame.quarter else self.corner
        planes = np.atleast_3d(self._frame.image(self.scene)).astype(np.float64)
        self._coefficients = np.stack(
            [ndimage.spline_filter(part, 3, output=np.float32, mode="mirror") for part in np.moveaxis(planes, -1, 0)],
            axis=-1,
        )

    def recorded(self, n: int, samples: int) -> NDArray[np.float32]:
        """Return the light of an exposure with noise."""
        light = self.light(n, samples)
        return light + self._random.normal(0.0, self._noise, light.shape).astype(np.float32)

    def light(self, n: int, samples: int) -> NDArray[np.float32]:
        """Return what an exposure records in so many warps of each row, as stored, with the axes of the scene."""
        opens, closes = self.windows[n]
        if samples * len(opens) > MOST_WARPS:
            raise InputError(f"the blur takes {samples} warps for each row; {MOST_WARPS // len(opens)} are possible")
        # The middles of equal parts of the exposure.
        times = opens[:, None] + (closes - opens)[:, None] * (np.arange(samples) + 0.5) / samples
        stored = self._frame.stored
        light = np.ascontiguousarray(self._frame.back(self._seen(times)))
        return light.reshape(stored.height, stored.width, *self.scene.shape[2:])

    def _seen(self, times: FloatArray) -> NDArray[np.float32]:
        """Return the mean of what the camera sees at `times` (H, T) of each row, upright, shape (H, W, C)."""
        camera, (left, top) = self.path.camera, self._corner
        if camera.distortion_model != "none":
            return self._through_lens(times)
        shift = np.array([[1.0, 0.0, left], [0.0, 1.0, top], [0.0, 0.0, 1.0]])
        warps = shift @ camera.matrix @ self.path.turns(times, self._reference) @ np.linalg.inv(camera.matrix)
        return average_warps(self._coefficients, warps, camera.width)

    def _through_lens(self, times: FloatArray) -> NDArray[np.float32]:
        """Return the same for a distorting lens, whose warps are not homographies: pixels are traced."""
        camera, coefficients = self.path.camera, self._coefficients
        directions = camera.rays(np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1))
        turns = self.path.turns(times, self._reference)
        out = np.empty((camera.height, camera.width, coefficients.shape[2]), dtype=np.float32)
        for y in range(camera.height):
            at = camera.project(np.einsum("tij,xj->txi", turns[y], directions[y])) + self._corner
            at = np.moveaxis(at[..., ::-1], -1, 0)
            for c, part in enumerate(np.moveaxis(coefficients, -1, 0)):
                out[y, :, c] = ndimage.map_coordinates(part, at, order=3, mode="mirror", prefilter=False).mean(axis=0)
        return out


def _linear_scene(sharp: ArrayLike, transfer: Transfer | Auto) -> tuple[NDArray[np.float32], Transfer]:
    """Return the scene in linear light, and how its values encoded it."""
    values = validate.array("sharp", sharp)
    if values.ndim not in (2, 3) or values.size == 0:
        raise InputError(f"sharp must be a picture of shape (h, w) or (h, w, C), got {values.shape}")
    if values.dtype not in (np.uint8, np.uint16) and not np.issubdtype(values.dtype, np.floating):
        raise InputError(f"sharp must be uint8, uint16 or float, got {values.dtype}")
    encoding = resolve_transfer(transfer, values.dtype)
    scene = to_linear(as_float(values), encoding)
    validate.bounded("sharp", scene)
    return scene, encoding


class CameraPath:
    """Pose of the camera over time; its orientation is integrated by many midpoint steps of the interpolated rates."""

    def __init__(
        self,
        log: GyroLog,
        frame: ReadoutFrame,
        span: tuple[float, float],
        epoch_ns: int,
        translation: Translation | None,
    ) -> None:
        (t0, t1), camera = span, frame.camera
        if translation is not None and not isinstance(translation.depth, float):
            raise InputError("translation must have one depth to be simulated, got a map of depths")
        if (t1 - t0) * STEPS_PER_SECOND > 2_000_000:  # 100 s
            raise InputError(f"the exposures span {t1 - t0:g} s, too long to be simulated; are their times in s?")
        samples = log.covering(t0 - camera.time_offset, t1 - camera.time_offset, epoch_ns)
        t = samples.t + camera.time_offset
        omega = samples.omega @ camera.imu_to_camera.T
        self.nodes = np.linspace(t0, t1, max(2, int(np.ceil((t1 - t0) * STEPS_PER_SECOND)) + 1))
        centres = 0.5 * (self.nodes[1:] + self.nodes[:-1])
        self.rates = np.stack([np.interp(centres, t, omega[:, axis]) for axis in range(3)], axis=1)
        # In camera axes, a far point X moves by dX/dt = -omega x X.
        steps = Rotation.from_rotvec(-self.rates * np.diff(self.nodes)[:, None])
        turned = Rotation.concatenate([Rotation.identity(), steps])
        reach = 1
        while reach < len(turned):  # products of 2, 4, 8, ... neighbours
            turned = Rotation.concatenate([turned[:reach], turned[reach:] * turned[:-reach]])
            reach *= 2
        self.orientation = Slerp(self.nodes, turned)
        self.frame, self.camera = frame, camera
        self.places = translation and translation.covering(t0, t1, epoch_ns)

    def longest(self, opens: FloatArray, closes: FloatArray) -> float:
        """Return an upper bound in px on the length of all paths between `opens` and `closes`."""
        focal_length, (cx, cy) = max(self.camera.focal_length), self.camera.principal_point
        radius = np.hypot(max(cx, self.camera.width - 1 - cx), max(cy, self.camera.height - 1 - cy))
        # At a distance r from the principal point, perspective multiplies f by 1 + (r/f)^2.
        tilt, roll = np.hypot(self.rates[:, 0], self.rates[:, 1]), np.abs(self.rates[:, 2])
        speed = focal_length * (1.0 + (radius / min(self.camera.focal_length)) ** 2) * tilt + radius * roll
        steps = speed * np.diff(self.nodes)
        if self.places is not None:
            steps = steps + 2 * focal_length * np.linalg.norm(np.diff(self.places.at(self.nodes), axis=0), axis=1)
        travelled = np.concatenate([[0.0], np.cumsum(steps)])
        lengths = np.interp(closes, self.nodes, travelled) - np.interp(opens, self.nodes, travelled)
        return float(lengths.max())

    def turns(self, times: FloatArray, reference: float) -> FloatArray:
        """Return the matrices from camera directions at `times` to those at `reference`, `times.shape + (3, 3)`."""
        at_reference = self.orientation([reference]).as_matrix()[0]
        at_times = self.orientation(times.ravel()).as_matrix().reshape(*times.shape, 3, 3)
        turns: FloatArray = at_reference @ np.swapaxes(at_times, -1, -2)
        if self.places is None:
            return turns
        # From position s, in reference axes, direction r meets the plane z = 1 at s + r (1 - s_z) / r_z.
        s = (self.places.at(times) - self.places.at(np.array(reference))) @ at_reference.T
        meeting = (1.0 - s[..., 2, None, None]) * np.eye(3)
        meeting[..., 2] += s
        values: FloatArray = meeting @ turns
        return values
