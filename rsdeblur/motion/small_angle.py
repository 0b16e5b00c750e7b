"""Displacements by the small-angle approximation of the published method."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rsdeblur.types import FloatArray

if TYPE_CHECKING:
    from rsdeblur.motion.paths import Capture


def small_angle_displacements(
    capture: Capture, times: FloatArray, reference: FloatArray, depth: FloatArray
) -> FloatArray:
    """Return displacements from a reference time on by the small-angle approximation (Sindelar and Sroubek 2013).

    Parameters
    ----------
    capture : Capture
        The motion.
    times : ndarray, shape (..., T)
        Times in s.
    reference : ndarray, shape (...)
        Time of no displacement, s.
    depth : ndarray, shape (...)
        Depth of the scene, see :meth:`Capture.depth`.

    Returns
    -------
    ndarray, shape (..., T, 2)
        (x, y) in px; leading axes are broadcast.
    """
    angles = capture.track.angles(times) - capture.track.angles(reference)[..., None, :]
    shifts = capture.position(times) - capture.position(reference)[..., None, :]
    # The picture moves by f (-theta_y, +theta_x), and opposite to the camera's translation.
    turns = np.stack([-angles[..., 1], angles[..., 0]], axis=-1)
    d: FloatArray = (turns - shifts[..., :2] / depth[..., None, None]) * capture.camera.focal_length
    return d
