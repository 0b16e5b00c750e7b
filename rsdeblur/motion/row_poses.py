"""Poses of the camera at the mid-exposures of all rows of a picture."""

from __future__ import annotations

from dataclasses import dataclass

from rsdeblur.kernels.poses import row_directions
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RowPoses:
    """Camera poses at the mid-exposures of all rows, for projection.

    Parameters
    ----------
    camera : Camera
        The camera, with a picture of H rows.
    matrices : ndarray, shape (2 H, 12)
        Matrices `C(mid(y)) [I | -P(mid(y))]` for the rows y from -H/2 on.
    """

    camera: Camera
    matrices: FloatArray

    def project(self, world: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the pixels at which points appear, each with the pose of a row.

        Poses are interpolated linearly between rows; from row to row they differ by at most 1e-4 rad in a picture of
        thousands of rows.

        Parameters
        ----------
        world : ndarray, shape (..., 3)
            Directions in world axes, or points in units of the scene's depth.
        rows : ndarray, shape (...)
            Rows in px, fractions allowed.

        Returns
        -------
        ndarray, shape (..., 2)
            (x, y) in px.
        """
        # A point that the lens does not show has no row: any pose will do, as its position stays NaN.
        return self.camera.project(row_directions(world, rows, self.matrices))
