"""Segments: a few consecutive frames of a video, deblurred and encoded into one file."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.memory import empty
from rsdeblur.choices import CRF
from rsdeblur.errors import InputError, OutputError
from rsdeblur.video._av import av
from rsdeblur.video.clip import Clip, frames
from rsdeblur.video.pixels import frame_of, kept_frame, matrix_of, values_of
from rsdeblur.video.plan import ClipPlan

# Encoder for each decoder name.
ENCODERS = {
    "h264": "libx264",
    "hevc": "libx265",
    "vp9": "libvpx-vp9",
    "libvpx-vp9": "libvpx-vp9",
    "av1": "libsvtav1",
    "libdav1d": "libsvtav1",
    "prores": "prores_ks",
    "rawvideo": "ffv1",  # lossless, too
}
# Joined segments of it cannot be decoded: the pixel format is lost.
UNJOINED = "rawvideo"
# No frame refers to a later one, so packets come in the order of the frames and segments can be joined.
OPTIONS = {
    # Intra blocks of 4 x 4 pixels would take a tenth more time for files of no better quality.
    "libx264": {"preset": "veryfast", "partitions": "p8x8,i8x8"},
    "libx265": {"preset": "fast", "x265-params": "log-level=none"},
    "libvpx-vp9": {"b": "0", "deadline": "good", "cpu-used": "3", "auto-alt-ref": "0", "lag-in-frames": "0"},
    "libsvtav1": {"preset": "8", "svtav1-params": "pred-struct=1"},
}
FALLBACK = "libx264"
CONTAINER = "matroska"


@dataclass(frozen=True, slots=True)
class Encoding:
    """Encoding of the frames.

    Parameters
    ----------
    codec : str
        FFmpeg's name of the encoder.
    pixels : str
        Pixel format.
    crf : int
        Constant rate factor: lower is better and larger.
    """

    codec: str
    pixels: str
    crf: int

    @classmethod
    def like(cls, clip: Clip, *, codec: str | None = None, crf: int = CRF) -> Encoding:
        """Return the clip's encoding, or that of another `codec` with the clip's pixel format if it supports it.

        Raises
        ------
        InputError
            If FFmpeg has no video encoder of that name, or it is "rawvideo".
        """
        if codec == UNJOINED:
            raise InputError(f"segments of {codec} cannot be joined; use ffv1, which is lossless, too")
        name = codec or ENCODERS.get(clip.codec, clip.codec)
        encoder = _encoder(name) or (_encoder(FALLBACK) if codec is None else None)
        if encoder is None:
            raise InputError(f"FFmpeg has no video encoder called {name!r}; try libx264 or libx265")
        # The formats yuvj mean full range, which is a tag of the stream as well.
        own = clip.pixels.replace("yuvj", "yuv")
        allowed = [kind.name for kind in encoder.video_formats or ()] or [own]
        deep = "10" in own or "12" in own
        for pixels in (own, "yuv420p10le" if deep else "yuv420p", allowed[0]):
            if pixels in allowed:
                return cls(encoder.name, pixels, crf)
        raise AssertionError("unreachable: the first allowed format is allowed")


def _encoder(name: str) -> Any:
    try:
        encoder = av.Codec(name, "w")
    except av.codec.codec.UnknownCodecError:
        return None
    return encoder if encoder.type == "video" else None


@dataclass(frozen=True, slots=True)
class Segment:
    """Frames `first` to `stop - 1` of a planned video, and the file that they are encoded into."""

    plan: ClipPlan
    first: int
    stop: int
    encoding: Encoding
    output: Path


def encode_segment(segment: Segment) -> None:
    """Deblur and encode the frames of a segment; its file appears whole or not at all.

    Raises
    ------
    FileFormatError, OutputError
        If a frame cannot be decoded, or the file cannot be written.
    """
    plan, pixels = segment.plan, segment.encoding.pixels
    try:
        with (
            atomic_write(segment.output) as file,
            av.open(file, "w", format=CONTAINER) as container,
            ThreadPoolExecutor(1) as beside,
        ):
            stream = add_stream(container, plan.clip, segment.encoding)
            # A frame is encoded while the next one is deblurred; no more than one waits.
            written: Future[list[Any]] = beside.submit(list)
            decoded = frames(plan.clip, segment.first, segment.stop, threads=plan.options.threads)
            for index, frame in enumerate(decoded, segment.first):
                sharp, share = None, plan.shares[index]
                if share:
                    values = values_of(frame)
                    sharp = _mixed(
                        values, plan.frame(index).apply(values, out=empty(values.shape, np.uint16)).image, share
                    )
                container.mux(written.result())
                written = beside.submit(_encoded, stream, frame, sharp, pixels)
            container.mux(written.result())
            container.mux(stream.encode())
    except av.error.FFmpegError as error:
        raise OutputError(f"{segment.output}: cannot encode the video: {error.strerror}") from error


def _encoded(stream: Any, frame: Any, sharp: NDArray[np.uint16] | None, pixels: str) -> list[Any]:
    """Return the packets of a frame in the pixel format `pixels`, with the values `sharp` if it has new ones."""
    frame = kept_frame(frame, pixels) if sharp is None else frame_of(sharp, frame, pixels)
    packets: list[Any] = stream.encode(frame)
    return packets


def _mixed(values: NDArray[np.uint16], sharp: NDArray[np.uint16], share: float) -> NDArray[np.uint16]:
    """Return a frame mixed with its deblurred version."""
    if share == 1:
        return sharp
    mixed = np.float32(1 - share) * values
    mixed += np.float32(share) * sharp
    levels: NDArray[np.uint16] = np.rint(mixed, out=mixed).astype(np.uint16)
    return levels


def add_stream(container: Any, clip: Clip, encoding: Encoding) -> Any:
    """Return a new stream of a container, with its encoder, for the frames of a clip."""
    # SVT-AV1 logs to stderr; level 1 means errors only.
    os.environ.setdefault("SVT_LOG", "1")
    options = {"crf": str(encoding.crf)} | OPTIONS.get(encoding.codec, {})
    stream = container.add_stream(encoding.codec, rate=clip.rate, options=options)
    stream.width, stream.height, stream.pix_fmt = clip.width, clip.height, encoding.pixels
    context = stream.codec_context
    context.time_base = clip.time_base
    if clip.aspect is not None:
        context.sample_aspect_ratio = clip.aspect
    context.max_b_frames = 0
    # The bits may depend on the encoder's number of threads; a resumed video must get the same ones.
    context.thread_count = 1
    context.color_range = clip.colours.range
    context.color_primaries, context.color_trc = clip.colours.primaries, clip.colours.transfer
    context.colorspace = matrix_of(clip.colours.space, clip.pixels, encoding.pixels)
    return stream
