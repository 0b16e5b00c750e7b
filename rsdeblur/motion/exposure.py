"""Time of the exposure, of the whole picture and of each row."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.types import FloatArray


@dataclass(frozen=True, slots=True)
class Exposure:
    """Start and duration of one exposure, in camera time.

    Parameters
    ----------
    start : float
        Timestamp of the capture, in s relative to `epoch_ns`. It is the start of exposure of the first row read, unless
        the camera's `timestamp_marks` names another moment.
    duration : float
        Exposure time of every row in s, positive.
    epoch_ns : int, default 0
        Origin of `start`, in nanoseconds, within 64 bits.

    Raises
    ------
    InputError
        If a value is not finite or beyond 1e12, the duration is not positive, or `epoch_ns` does not fit into 64 bits.

    Examples
    --------
    >>> import rsdeblur
    >>> camera = rsdeblur.Camera(640, 480, 500.0, readout_time=0.03)
    >>> opens, closes = rsdeblur.Exposure(0.25, 0.05).window([0, 240], camera)
    >>> opens, closes
    (array([0.25 , 0.265]), array([0.3  , 0.315]))
    """

    start: float
    duration: float
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", validate.time("start", self.start))
        object.__setattr__(self, "duration", validate.time("duration", self.duration, above=0.0))
        object.__setattr__(self, "epoch_ns", validate.nanoseconds("epoch_ns", self.epoch_ns))

    def window(self, rows: ArrayLike, camera: Camera) -> tuple[FloatArray, FloatArray]:
        """Return the times at which the exposure of each row starts and ends.

        Parameters
        ----------
        rows : array_like
            Positions along the readout axis of the picture as stored (y, or x for a horizontal readout); any shape,
            fractions allowed.
        camera : Camera
            The camera, with its readout time, readout direction and `timestamp_marks`.

        Returns
        -------
        opens, closes : ndarray
            Starts and ends in s relative to `epoch_ns`, shaped like `rows`.

        Raises
        ------
        InputError
            If `rows` is not an array of finite numbers.
        """
        validate.instance("camera", camera, Camera)
        order = camera.reading_order(validate.real_array("rows", rows))
        # From the first row's start of exposure to the moment that the timestamp marks.
        whole = camera.readout_time * (camera.lines - 1) / camera.lines + self.duration
        first = self.start - TIMESTAMP_SHARES[camera.timestamp_marks] * whole
        opens: FloatArray = first + camera.readout_time * order / camera.lines
        return opens, opens + self.duration

    def span(self, camera: Camera) -> tuple[float, float]:
        """Return the start of the first row's exposure and the end of the last one's, in s relative to `epoch_ns`.

        Parameters
        ----------
        camera : Camera
            The camera, as for :meth:`window`.
        """
        validate.instance("camera", camera, Camera)
        opens, closes = self.window(np.array([0.0, camera.lines - 1.0]), camera)
        return float(opens.min()), float(closes.max())
