"""Conversion between FFmpeg's frames and arrays of RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import InputError
from rsdeblur.video._av import av

# 16 bits are enough for the RGB values of 8, 10 and 12 bits of YCbCr.
RGB, CHANNELS = "rgb48le", 3
FULL_RANGE = 2  # AVCOL_RANGE_JPEG; frames without a tag have the limited one
LIMITED_RANGE = 1
BT709 = 1  # AVCOL_SPC_BT709
# FFmpeg's default would darken pictures by a level.
SCALING = av.video.reformatter.Interpolation.BICUBIC | av.video.reformatter.Interpolation.ACCURATE_RND


def matrix_of(matrix: int, source: str, pixels: str) -> int:
    """Return FFmpeg's number of the matrix for frames of the pixel format `source` that are stored as `pixels`.

    It is the `matrix` of the original. RGB has none, or one that YCbCr cannot have.
    """
    was_rgb, is_rgb = (av.VideoFormat(name).is_rgb for name in (source, pixels))
    return BT709 if was_rgb and not is_rgb else matrix


def values_of(frame: Any) -> NDArray[np.uint16]:
    """Return a frame as RGB, shape (H, W, 3), decoded as its tags say.

    Raises
    ------
    InputError
        If FFmpeg cannot convert its colours.
    """
    try:
        rgb = frame.reformat(
            format=RGB,
            src_color_range=int(frame.color_range) or LIMITED_RANGE,
            dst_color_range=FULL_RANGE,
            interpolation=SCALING,
        )
    except av.error.FFmpegError as error:
        raise InputError(
            f"frames of {frame.format.name} with FFmpeg's colour matrix {int(frame.colorspace)} cannot be converted to "
            f"RGB ({error.strerror}); convert the video first"
        ) from error
    values: NDArray[np.uint16] = rgb.to_ndarray()
    return values


def frame_of(values: NDArray[np.uint16], like: Any, pixels: str) -> Any:
    """Return RGB values as a frame in the pixel format `pixels`, with the tags and the stamp of the frame `like`."""
    matrix = matrix_of(int(like.colorspace), like.format.name, pixels)
    frame = av.VideoFrame.from_ndarray(values, format=RGB).reformat(
        format=pixels,
        dst_colorspace=matrix,
        src_color_range=FULL_RANGE,
        dst_color_range=int(like.color_range) or LIMITED_RANGE,
        interpolation=SCALING,
    )
    frame.color_range, frame.colorspace = like.color_range, matrix
    frame.color_primaries, frame.color_trc = like.color_primaries, like.color_trc
    frame.pts, frame.time_base = like.pts, like.time_base
    return frame


def kept_frame(frame: Any, pixels: str) -> Any:
    """Return a frame, whose values are not changed, in the pixel format `pixels`."""
    matrix = matrix_of(int(frame.colorspace), frame.format.name, pixels)
    frame = frame.reformat(format=pixels, dst_colorspace=matrix, interpolation=SCALING)
    frame.pict_type = 0  # the encoder chooses
    return frame
