"""When the picture was taken, and when each of its rows was exposed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray


@dataclass(frozen=True, slots=True)
class Exposure:
    """One exposure, in camera time.

    Parameters
    ----------
    start : float
        The capture's stamp, in s relative to `epoch_ns`: the start of exposure of the first row read, unless the
        camera's `timestamp_marks` says that it marks another moment.
    duration : float
        Exposure time of every row in s, positive.
    epoch_ns : int, default 0
        Origin of `start` in integer nanoseconds.

    Raises
    ------
    InputError
        If a value is not finite or the duration is not positive.
    """

    start: float
    duration: float
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", validate.finite("start", self.start))
        object.__setattr__(self, "duration", validate.finite("duration", self.duration, above=0.0))
        object.__setattr__(self, "epoch_ns", validate.stamp("epoch_ns", self.epoch_ns))

    def shifted(self, dt: float) -> Exposure:
        """Return the exposure `dt` seconds later."""
        return replace(self, start=self.start + validate.finite("dt", dt))

    def window(self, rows: ArrayLike, camera: Camera) -> tuple[FloatArray, FloatArray]:
        """Return when each row opens and closes.

        Parameters
        ----------
        rows : array_like
            Positions along the readout axis of the picture as stored (y, or x for a horizontal readout); any shape,
            fractions allowed.
        camera : Camera
            Gives the readout time and its direction.

        Returns
        -------
        opens, closes : ndarray
            Times in s relative to `epoch_ns`, shaped like `rows`.
        """
        order = camera.reading_order(validate.real_array("rows", rows))
        first = self.start - camera.stamp_delay(self.duration)
        opens: FloatArray = first + camera.readout_time * order / camera.lines
        return opens, opens + self.duration

    def span(self, camera: Camera) -> tuple[float, float]:
        """Return when the first row opens and the last row closes, in s relative to `epoch_ns`."""
        opens, closes = self.window(np.array([0.0, camera.lines - 1.0]), camera)
        return float(opens.min()), float(closes.max())
