"""Poses of the camera at the mid-exposures of all rows of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsdeblur.kernels.poses import pinhole_paths, row_directions
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

    def paths(
        self,
        orientation: FloatArray,
        position: FloatArray,
        scene: FloatArray,
        grid: tuple[FloatArray, FloatArray],
        *,
        steps: int,
    ) -> FloatArray:
        """Return the displacements of pixels on a grid, by fixed-point iteration over the rows that they fall on.

        Parameters
        ----------
        orientation, position, scene
            See :func:`rsdeblur.kernels.poses.pinhole_paths`.
        grid : (ndarray, ndarray)
            Rows (B,) and columns (S,), px.
        steps : int
            Steps of the iteration, which begins at the row of the pixel.

        Returns
        -------
        ndarray, shape (B, S, T, 2)
            Displacements (x, y) in px; NaN where the lens shows nothing.
        """
        if self.camera.distortion_model == "none":
            pinhole = *self.camera.focal_length, *self.camera.principal_point
            return pinhole_paths(orientation, position, scene, *grid, self.matrices, pinhole, steps)
        rows, cols = grid
        points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None]  # (B, S, 1, 2), x before y
        world = np.einsum("btji,bsj->bsti", orientation, scene) + position[:, None]
        pixels = np.broadcast_to(points, (*world.shape[:-1], 2))
        for _ in range(steps):
            pixels = self.project(world, pixels[..., 1])
        displacements: FloatArray = points - pixels
        return displacements

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
