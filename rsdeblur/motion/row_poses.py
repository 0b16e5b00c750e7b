"""Poses of the camera at the mid-exposures of all rows of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsdeblur.kernels.poses import pinhole_paths, row_directions
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RowPoses:
    """Camera poses at the mid-exposures of all H rows of a picture, for projection."""

    camera: Camera
    matrices: FloatArray  # (2 H, 12): C(mid(y)) [I | -P(mid(y))] for the rows y from -H/2 on

    def paths(
        self,
        orientation: FloatArray,
        position: FloatArray,
        scene: FloatArray,
        grid: tuple[FloatArray, FloatArray],
        *,
        steps: int,
    ) -> FloatArray:
        """Return the displacements (B, S, T, 2) of pixels on a grid, (x, y) in px; NaN where the lens shows nothing.

        `grid` contains B rows and S columns in px; the other arguments are those of
        :func:`rsdeblur.kernels.poses.pinhole_paths`. The fixed-point iteration over the rows that points fall on begins
        at the row of the pixel.
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
        """Return the pixels (x, y), shape (..., 2), at which points `world` (..., 3) appear by the poses of `rows`.

        Points are directions in world axes, or places in units of the scene's depth. Poses are interpolated linearly
        between rows, which may be fractions; from row to row they differ by at most 1e-4 rad in a picture of thousands
        of rows.
        """
        # A point that the lens does not show has no row: any pose will do, as its position stays NaN.
        return self.camera.project(row_directions(world, rows, self.matrices))
