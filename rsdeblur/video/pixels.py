"""Conversion between FFmpeg's frames and arrays of RGB."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.video._av import av

# 16 bits are enough for the RGB values of 8, 10 and 12 bits of YCbCr.
RGB = "rgb48le"
FULL_RANGE = 2  # AVCOL_RANGE_JPEG; frames without a tag have the limited one
LIMITED_RANGE = 1


def values_of(frame: Any) -> NDArray[np.uint16]:
    """Return a frame as RGB, shape (H, W, 3), decoded as its tags say."""
    kind = av.video.reformatter.Interpolation
    rgb = frame.reformat(
        format=RGB,
        src_color_range=int(frame.color_range) or LIMITED_RANGE,
        dst_color_range=FULL_RANGE,
        interpolation=kind.BICUBIC | kind.ACCURATE_RND,
    )
    values: NDArray[np.uint16] = rgb.to_ndarray()
    return values


def frame_of(values: NDArray[np.uint16], like: Any, pixels: str) -> Any:
    """Return RGB values as a frame in the pixel format `pixels`, with the tags and the stamp of the frame `like`."""
    kind = av.video.reformatter.Interpolation
    frame = av.VideoFrame.from_ndarray(values, format=RGB).reformat(
        format=pixels,
        dst_colorspace=int(like.colorspace),
        src_color_range=FULL_RANGE,
        dst_color_range=int(like.color_range) or LIMITED_RANGE,
        interpolation=kind.BICUBIC | kind.ACCURATE_RND,
    )
    frame.color_range, frame.colorspace = like.color_range, like.colorspace
    frame.color_primaries, frame.color_trc = like.color_primaries, like.color_trc
    frame.pts, frame.time_base = like.pts, like.time_base
    return frame
