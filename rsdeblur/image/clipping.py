"""Colours beside what the sensor clipped: there a result keeps to the colours of the photo around it.

A clipped pixel recorded less than the light that reached it, and each channel clips elsewhere. The solve takes the cut
for an edge of the scene, another one in each channel, and leaves dark and coloured lines beside it. The colours that
the photo itself has there limit those of the result. Its darkness limits that of the result loosely, because blur
lowers the contrast of small things, such as letters on white paper.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util import validate
from rsdeblur._util.threads import share
from rsdeblur.image.encoded import ROWS, EncodedImage
from rsdeblur.image.highlights import full_scale
from rsdeblur.kernels.mend import extremes, limit
from rsdeblur.types import Float32Array, FloatImage

# Side of the window around a pixel that the photo's range is taken over, in lengths of the PSF: light of the pixel went
# half a PSF far, and as far again reaches what came from there.
WINDOW = 1.5
# By how much a result may leave the range of the photo: as a share of the range, below its luma and beyond its
# chroma, and at least, as the square root of light. (docs/developer/decisions.md)
DARKER, MORE_COLOURED, LEAST_BEYOND = 1.0, 0.1, 1 / 255
# Luma, as the square root of light, from which a cell is white: 250 of 255 in sRGB, for JPEG's sake.
WHITE = 0.978
# Cells in the length of a PSF, the least size of a cell in px, and the number of cells over which the limits set in.
CELLS, LEAST_CELL, FADE = 8, 8, 3


def keep_colours_near_clipped(
    sharp: FloatImage,
    encoded: EncodedImage,
    first: int,
    size: tuple[int, int],
    *,
    threads: int | None = None,
) -> None:
    """Limit luma and chroma of a result in place, beside pixels that the blurred picture has at full scale.

    `sharp` (h, W, C) is linear light from the row `first` of the blurred picture on; `size` is that of the largest PSF,
    px.
    """
    height, _, channels = sharp.shape
    values = encoded.values[first : first + height, :, :channels]
    white = full_scale(values)
    # A float picture that exceeds 1 was not clipped there.
    if values.max() < white or (values.dtype.kind != "u" and encoded.values[..., :channels].max() > white):
        return
    step = max(LEAST_CELL, size[0] // CELLS), max(LEAST_CELL, size[1] // CELLS)
    window = tuple(2 * int(np.ceil(WINDOW / 2 * length / cell)) + 1 for length, cell in zip(size, step, strict=True))
    photo = EncodedImage(values, encoded.transfer)
    clipped = _clipped(photo, white, step, threads)
    near = ndimage.uniform_filter(ndimage.maximum_filter(clipped, window, mode="nearest"), FADE, mode="nearest")
    # Limits are interpolated between cells, of which some have no weight.
    needed = ndimage.maximum_filter(near > 0, [n + 2 for n in window], mode="nearest")
    lowest, highest = _extremes(photo, needed, step, threads)
    low = ndimage.minimum_filter(lowest, (*window, 1), mode="nearest")
    high = ndimage.maximum_filter(highest, (*window, 1), mode="nearest")
    luma, chroma = high[..., :1] - low[..., :1], (high - low)[..., 1:].max(axis=2, keepdims=True)
    # Channels share the widest range of the chroma.
    beyond = np.concatenate([DARKER * luma, *[MORE_COLOURED * chroma] * channels], axis=2)
    least, most = low - beyond - np.float32(LEAST_BEYOND), high + beyond + np.float32(LEAST_BEYOND)
    # What is white over a whole PSF was nowhere darker.
    psf = tuple(-(-length // cell) for length, cell in zip(size, step, strict=True))
    whole = ndimage.grey_opening((lowest[..., 0] >= WHITE).view(np.uint8), psf, mode="nearest") > 0
    least[whole, 0] = lowest[whole, 0]
    # Nothing says how bright clipped light was at most.
    most[..., 0] = validate.MOST_LIGHT

    def limit_rows(_: int, top: int) -> None:
        limit(sharp[top : top + ROWS], top, *step, near, least, most)

    share(limit_rows, range(0, height, ROWS), threads)


def _clipped(photo: EncodedImage, white: float, step: tuple[int, int], threads: int | None) -> Float32Array:
    """Return 1 for cells with a clipped pixel, else 0."""
    height, width, channels = photo.shape
    clipped = np.zeros((-(-height // step[0]), -(-width // step[1])), np.float32)

    def find(_: int, n: int) -> None:
        brightest: NDArray[np.generic] = photo.values[n * step[0] : (n + 1) * step[0]].max(axis=0)
        clipped[n, np.flatnonzero(brightest == white) // (step[1] * channels)] = 1

    share(find, range(len(clipped)), threads)
    return clipped


def _extremes(
    photo: EncodedImage, needed: NDArray[np.bool_], step: tuple[int, int], threads: int | None
) -> tuple[Float32Array, Float32Array]:
    """Return the extremes of luma and chroma in the cells that are needed, and 0 in the others."""
    lowest, highest = np.zeros((2, *needed.shape, photo.shape[2] + 1), np.float32)

    def measure(_: int, n: int) -> None:
        rows = photo.values[n * step[0] : (n + 1) * step[0]]
        # Each run of needed cells begins and ends where they change.
        changes = np.flatnonzero(np.diff(needed[n], prepend=False, append=False))
        for first, end in changes.reshape(-1, 2):
            cells = EncodedImage(rows[:, first * step[1] : end * step[1]], photo.transfer).linear(slice(None))
            extremes(np.sqrt(np.maximum(cells, 0)), step[1], lowest[n, first:end], highest[n, first:end])

    share(measure, range(len(needed)), threads)
    return lowest, highest
