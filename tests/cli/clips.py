"""Small videos for the tests of several commands."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.installed import needs

BT709 = 1


def write_clip(
    path: Path,
    pictures: Sequence[NDArray[Any]],
    *,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    rate: int = 30,
    tick: Fraction | None = None,
    times: Sequence[int] | None = None,
    tagged: bool = False,
    turn: int = 0,
    sound: bool = False,
    data: Sequence[bytes] = (),
    **facts: Any,
) -> Path:
    """Encode RGB pictures (8 bits, or display values) one `tick` apart or at `times`, with key frames 4 apart.

    `turn` is a display rotation in degrees, `tagged` adds the colour tags of BT.709, `data` are packets of a data
    stream, one for each frame, and `facts` are set in the encoder.
    """
    av = needs("video")
    tick = tick or Fraction(1, rate)
    with av.open(f"file:{path}", "w") as container:
        stream = container.add_stream(codec, rate=rate, options={"crf": "4"} if codec == "libx264" else {})
        stream.pix_fmt, context = pixels, stream.codec_context
        stream.height, stream.width = pictures[0].shape[:2]
        context.time_base, context.gop_size = tick, 4
        context.color_range = 2 if pixels == "yuvj420p" else 1
        if tagged:
            context.colorspace = context.color_primaries = context.color_trc = BT709
        if turn:
            stream.set_display_rotation(turn)
        for name, value in facts.items():
            setattr(context, name, value)
        audio = container.add_stream("aac", rate=48000) if sound else None
        extra = container.add_data_stream("bin_data") if data else None
        for i, picture in enumerate(pictures):
            values = picture.astype(np.uint16) * 257 if picture.dtype == np.uint8 else np.rint(65535 * picture)
            frame = av.VideoFrame.from_ndarray(values.astype(np.uint16), format="rgb48le")
            space = {"dst_colorspace": BT709} if tagged else {}
            frame = frame.reformat(format=pixels, dst_color_range=int(context.color_range), **space)
            frame.pts, frame.time_base = i if times is None else times[i], tick
            container.mux(stream.encode(frame))
            if extra is not None:
                packet = av.Packet(data[i])
                packet.stream, packet.pts, packet.dts, packet.duration, packet.time_base = extra, i, i, 1, tick
                container.mux(packet)
        for i in range(15 if audio else 0):
            wave = np.sin(np.arange(1024 * i, 1024 * (i + 1)) / 20).astype(np.float32)[None]
            samples = av.AudioFrame.from_ndarray(0.1 * wave, format="fltp", layout="mono")
            samples.sample_rate, samples.pts = 48000, 1024 * i
            container.mux(audio.encode(samples))
        container.mux(stream.encode())
        if audio is not None:
            container.mux(audio.encode())
    return path
