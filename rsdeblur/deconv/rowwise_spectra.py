"""From pictures to lanes and back: row spectra sorted into blocks of 16 frequencies, which the rowwise kernels take.

Every frequency is a problem of its own, along y. A block of 16 of them, one to a SIMD lane, is worked on by one thread;
threads share blocks of picture rows and blocks of frequencies, and any number of threads gives the same bits.
"""

from __future__ import annotations

import numpy as np

from rsdeblur._util.threads import ThreadTeam
from rsdeblur.deconv.border import fade
from rsdeblur.deconv.fft import Planning, Real, RowTransform, empty
from rsdeblur.deconv.tiling import Tile
from rsdeblur.kernels import lines, rowwise

# Picture rows per block.
ROWS = 16


class RowSpectra:
    """Row transforms of one length for pictures of `channels`, shared out to `threads`.

    Parameters
    ----------
    channels, length : int
        Channels of the pictures and transform length in px.
    planning : {"estimate", "measure"}
        How FFTW plans.
    threads : int
        Number of threads.
    """

    def __init__(self, channels: int, length: int, *, planning: Planning, threads: int) -> None:
        self.channels, self.length, self.team = channels, length, ThreadTeam(threads)
        self.blocks = -(-(length // 2 + 1) // rowwise.LANES)
        self._rows = [RowTransform((channels, ROWS, length), planning) for _ in range(threads)]

    def empty(self, rows: int) -> Real:
        """Return lanes for `rows` rows, zero: frequencies that fill up the last block stay so."""
        lanes: Real = empty((self.blocks, self.channels, rows, 2, rowwise.LANES), np.float32)
        lanes[...] = 0
        return lanes

    def load(self, picture: Real, lanes: Real, *, start: int = 0, taper: int = 0, periodic: bool = True) -> None:
        """Transform the rows of `picture` (H, W, C), each cut from `start` on, into `lanes`."""
        ramp = fade(taper)
        height = lanes.shape[2]

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, height - top), self._rows[thread]
            lines.picture_to_lines(picture, top, rows, start, ramp, periodic, buffers.real)
            buffers.forward()
            rowwise.spectra_to_lanes(buffers.spectrum, rows, lanes, top)

        self.team.share(block, range(0, height, ROWS))

    def unload(self, lanes: Real, first: int, out: Real, tile: Tile, *, add: bool = False) -> None:
        """Transform rows `first` on of `lanes` back and put, or add, them to `out` (H, W, C) where `tile` counts."""
        weights = tile.weights * np.float32(1 / self.length)

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, len(out) - top), self._rows[thread]
            rowwise.lanes_to_spectra(lanes, first + top, buffers.spectrum, rows)
            buffers.inverse()
            lines.lines_to_picture(buffers.real, rows, tile.first - tile.start, weights, tile.first, add, out, top)

        self.team.share(block, range(0, len(out), ROWS))
