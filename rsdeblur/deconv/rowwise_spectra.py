"""Row spectra in blocks of 16 frequencies, the layout of the rowwise kernels: from pictures and back.

Every frequency is an independent problem along y. One thread works on a block of 16 frequencies, one per SIMD lane, so
arrays in this layout are called lanes. Threads share blocks of picture rows and blocks of frequencies, and any number
of threads gives the same bits.
"""

from __future__ import annotations

import numpy as np

from rsdeblur._util.memory import empty
from rsdeblur._util.threads import ThreadTeam
from rsdeblur.choices import Planning
from rsdeblur.deconv.fft import RowTransform
from rsdeblur.deconv.tiling import Tile, fade
from rsdeblur.kernels import lines, rowwise
from rsdeblur.types import Float32Array

# Picture rows per block.
ROWS = 16


class RowSpectra:
    """Row transforms of one length, px, with the buffers of each thread."""

    def __init__(self, channels: int, length: int, *, planning: Planning, threads: int) -> None:
        self.channels, self.length, self.team = channels, length, ThreadTeam(threads)
        self.blocks = -(-(length // 2 + 1) // rowwise.LANES)
        self._rows = [RowTransform((channels, ROWS, length), planning) for _ in range(threads)]

    def empty(self, rows: int) -> Float32Array:
        """Return zeroed lanes for `rows` rows; frequencies that only fill up the last block stay zero."""
        lanes: Float32Array = empty((self.blocks, self.channels, rows, 2, rowwise.LANES), np.float32)
        lanes[...] = 0
        return lanes

    def load(
        self, picture: Float32Array, lanes: Float32Array, *, start: int = 0, taper: int = 0, periodic: bool = True
    ) -> None:
        """Transform the rows of `picture` (H, W, C), read from column `start` on, into `lanes`."""
        ramp = fade(taper)
        height = lanes.shape[2]

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, height - top), self._rows[thread]
            lines.picture_to_lines(picture, top, rows, start, ramp, periodic, buffers.real)
            buffers.forward()
            rowwise.spectra_to_lanes(buffers.spectra, rows, lanes, top)

        self.team.share(block, range(0, height, ROWS))

    def unload(self, lanes: Float32Array, first: int, out: Float32Array, tile: Tile, *, add: bool = False) -> None:
        """Transform `lanes` back from row `first` on; write to `out` (H, W, C), or add, where `tile` contributes."""
        weights = tile.weights * np.float32(1 / self.length)

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, len(out) - top), self._rows[thread]
            rowwise.lanes_to_spectra(lanes, first + top, buffers.spectra, rows)
            buffers.inverse()
            lines.lines_to_picture(buffers.real, rows, tile.first - tile.start, weights, tile.first, add, out, top)

        self.team.share(block, range(0, len(out), ROWS))
