"""The frame that everything is computed in: the picture turned so that its readout runs along y."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.choices import Motion
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.motion.translation import Translation
from rsdeblur.psf import PsfBank


@dataclass(frozen=True, slots=True, eq=False)
class ReadoutFrame:
    """The way into the upright frame, whose readout runs along y, and the way back.

    A picture with horizontal readout is turned a quarter clockwise on the way in; any other stays as it is. No other
    place in the package knows which.

    Parameters
    ----------
    stored : Camera
        The camera of the picture as stored.
    """

    stored: Camera

    @property
    def quarter(self) -> bool:
        """Whether the upright frame is turned by a quarter."""
        return self.stored.horizontal_readout

    @property
    def camera(self) -> Camera:
        """The camera of the upright picture."""
        return self.stored.turned() if self.quarter else self.stored

    def capture(
        self, log: GyroLog, exposure: Exposure, translation: Translation | None = None, *, motion: Motion = "rotation"
    ) -> Capture:
        """Return the motion of the upright camera; parameters and errors are those of `Capture.from_log`."""
        if translation is not None and self.quarter:
            translation = translation.turned()
        return Capture.from_log(log, self.camera, exposure, translation, motion=motion)

    def image(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the upright view of an array (H, W) or (H, W, C) that lies as stored."""
        return np.rot90(array, -1) if self.quarter else array

    def back(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return an upright array as a view that lies as stored."""
        return np.rot90(array) if self.quarter else array

    def bank(self, upright: PsfBank) -> PsfBank:
        """Return upright PSFs as they hold in the picture as stored."""
        return upright.turned(self.stored.height) if self.quarter else upright
