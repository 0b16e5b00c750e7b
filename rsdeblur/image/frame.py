"""The upright frame, in which everything is computed: the picture turned so that its readout runs along y."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.choices import Motion
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.motion.translation import Translation
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class ReadoutFrame:
    """Conversion between the picture as stored and the upright frame, whose readout runs along y.

    A picture with horizontal readout is turned a quarter clockwise; any other is left as it is. Everything else
    computes in the upright frame.
    """

    stored: Camera  # of the picture as stored

    @property
    def quarter(self) -> bool:
        """Whether the upright frame is turned by a quarter from the stored one."""
        return self.stored.horizontal_readout

    @property
    def camera(self) -> Camera:
        """The camera of the upright picture."""
        return self.stored.turned() if self.quarter else self.stored

    def capture(
        self,
        log: GyroLog,
        exposure: Exposure,
        translation: Translation | None = None,
        *,
        motion: Motion = "rotation",
        softness: float = 0.0,
    ) -> Capture:
        """Return the capture of the upright camera; parameters and errors are those of `Capture.from_log`."""
        return Capture.from_log(
            log, self.camera, exposure, self.translation(translation), motion=motion, softness=softness
        )

    def shift(self, stored: tuple[float, float]) -> tuple[float, float]:
        """Return a shift (x, y) of the stored picture as one of the upright picture."""
        return (-stored[1], stored[0]) if self.quarter else stored

    def translation(self, stored: Translation | None) -> Translation | None:
        """Return a translation of the stored camera as one of the upright camera."""
        return stored.turned() if stored is not None and self.quarter else stored

    def image(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the upright view of a stored array of shape (H, W) or (H, W, C)."""
        return np.rot90(array, -1) if self.quarter else array

    def back(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the stored view of an upright array."""
        return np.rot90(array) if self.quarter else array

    def bank(self, upright: PsfBank) -> PsfBank:
        """Return upright PSFs turned, with their places, to the picture as stored."""
        return upright.turned(self.stored.height) if self.quarter else upright


def upright(light: FloatImage, camera: Camera, scale: float) -> NDArray[np.float32]:
    """Return a picture as stored, shape (H, W), reduced by a factor and with the readout along y.

    It is smoothed against aliases first, by half of what a new pixel is longer than an old one, and interpolated
    linearly, as by `skimage.transform.resize`, which takes 0.14 s to import.
    """
    small = camera.scaled(scale)
    shape = small.height, small.width
    if light.shape != shape:
        ratios = np.divide(light.shape, shape)
        smooth = ndimage.gaussian_filter(light, np.maximum(ratios - 1, 0) / 2, mode="mirror")
        light = ndimage.zoom(smooth, 1 / ratios, order=1, mode="mirror", grid_mode=True)
    return np.ascontiguousarray(ReadoutFrame(small).image(light), dtype=np.float32)
