"""Conversion between FFmpeg's frames and arrays of RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.memory import empty
from rsdeblur.errors import InputError
from rsdeblur.kernels.ycbcr import Coding, from_rgb, to_rgb
from rsdeblur.video._av import av

# 16 bits are enough for the RGB values of 8, 10 and 12 bits of YCbCr.
RGB, CHANNELS = "rgb48le", 3
FULL_RANGE = 2  # AVCOL_RANGE_JPEG; frames without a tag have the limited one
LIMITED_RANGE = 1
BT709 = 1  # AVCOL_SPC_BT709
# Bits per value of the pixel formats of nearly all cameras. Kernels of this package convert them: FFmpeg takes four
# times as long.
BITS = {"yuv420p": 8, "yuvj420p": 8, "yuv420p10le": 10, "yuv420p12le": 12}
# Weights of red and blue for FFmpeg's number of the matrix: BT.709, BT.601, which FFmpeg takes where it is unknown, and
# BT.2020.
WEIGHTS = {1: (0.2126, 0.0722), **dict.fromkeys((2, 5, 6), (0.299, 0.114)), 9: (0.2627, 0.0593)}
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
    coding = _coding(frame.format.name, int(frame.colorspace), int(frame.color_range))
    # Some decoders deliver frames bottom-up.
    if coding is not None and frame.planes[0].line_size > 0:
        values = empty((frame.height, frame.width, CHANNELS), np.uint16)
        luma, cb, cr = _planes(frame)
        to_rgb(luma, cb, cr, coding, values)
        return values
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
    converted: NDArray[np.uint16] = rgb.to_ndarray()
    return converted


def frame_of(values: NDArray[np.uint16], like: Any, pixels: str) -> Any:
    """Return RGB values as a frame in the pixel format `pixels`, with tags and timestamp of the frame `like`."""
    matrix = matrix_of(int(like.colorspace), like.format.name, pixels)
    if (coding := _coding(pixels, matrix, int(like.color_range))) is not None:
        frame = av.VideoFrame(like.width, like.height, pixels)
        from_rgb(values, coding, *_planes(frame))
    else:
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


def _coding(pixels: str, matrix: int, colour_range: int) -> Coding | None:
    """Return what the values of a pixel format mean, or None if only FFmpeg converts it."""
    if pixels not in BITS or matrix not in WEIGHTS:
        return None
    is_full = colour_range == FULL_RANGE or pixels.startswith("yuvj")
    return Coding.of(*WEIGHTS[matrix], BITS[pixels], full_range=is_full)


def _planes(frame: Any) -> list[NDArray[Any]]:
    """Return the planes of a frame, which share its memory."""
    dtype = np.dtype(np.uint8 if BITS[frame.format.name] == 8 else np.uint16)
    return [
        np.frombuffer(plane, dtype).reshape(-1, plane.line_size // dtype.itemsize)[: plane.height, : plane.width]
        for plane in frame.planes
    ]
