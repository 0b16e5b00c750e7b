"""Files of videos: strangers' names and content, and what containers and encoders take."""

import os
import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur import Camera, Exposure, GyroLog, Options
from rsdeblur.errors import FileFormatError, InputError
from tests.cli.clips import write_clip
from tests.cli.test_errors import refused
from tests.installed import needs

av = needs("video")

from rsdeblur.video.clip import frames, open_clip, values_of  # noqa: E402 (needs PyAV)
from rsdeblur.video.encode import Encoding, deblur_video  # noqa: E402
from rsdeblur.video.plan import plan_clip  # noqa: E402

Run = Callable[..., Result]

WIDTH, HEIGHT, FRAMES = 64, 48, 8
TIMES = np.arange(0.0, 2.0, 0.005)
RATES = np.column_stack([np.sin(20 * TIMES), 0.5 * np.cos(9 * TIMES), 0 * TIMES])
CAMERA = Camera(WIDTH, HEIGHT, 70.0, readout_time=0.01)


def write(path: Path, *, count: int = FRAMES, **facts: object) -> None:
    """Write a video whose frames get brighter."""
    write_clip(path, [np.full((HEIGHT, WIDTH, 3), 50 + 4 * i, np.uint8) for i in range(count)], max_b_frames=2, **facts)


@pytest.fixture
def recording(tmp_path: Path) -> list[object]:
    """Write a log and a camera; return the options of every call."""
    log = np.column_stack([TIMES, RATES])
    np.savetxt(tmp_path / "gyro.csv", log, "%.6f", ",", header="t,wx,wy,wz", comments="")
    CAMERA.save(tmp_path / "camera.toml")
    files = ["--gyro", tmp_path / "gyro.csv", "--camera", tmp_path / "camera.toml"]
    return [*files, "--start", 0.1, "--duration", "1/60", "--nsr", 0.01, "--jobs", 2, "--above", 0]


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """Write the video."""
    write(tmp_path / "clip.mp4")
    return tmp_path / "clip.mp4"


def test_a_frame_that_cannot_be_deblurred_is_named_and_leaves_no_file(
    run: Run, clip: Path, recording: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise InputError("no colours")

    monkeypatch.setattr("rsdeblur.video.encode.values_of", fail)
    before = set(tmp_path.iterdir())
    refused(run("video", clip, *recording, "-o", tmp_path / "out.mp4"), f"{clip}: frame 0: no colours")
    assert set(tmp_path.iterdir()) == before


def test_an_interrupted_video_leaves_nothing(clip: Path, tmp_path: Path) -> None:
    before, unfinished = set(tmp_path.iterdir()), []

    def interrupt(stage: str, _: float) -> None:
        if "of 8 frames" in stage:
            unfinished.extend(set(tmp_path.iterdir()) - before)
            raise KeyboardInterrupt

    opened = open_clip(clip)
    exposures = [Exposure(0.1 + time, 1 / 60) for time in opened.times]
    options = Options(prior="wiener", nsr=0.01, check=False)
    plan = plan_clip(opened, GyroLog(TIMES, RATES), CAMERA, exposures, options, above=0.0)
    with pytest.raises(KeyboardInterrupt):
        deblur_video(plan, tmp_path / "out.mp4", encoding=Encoding.like(opened), jobs=2, progress=interrupt)
    assert len(unfinished) == 1
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("options", "output", "words"),
    [
        ((), "x.webm", ("x.webm: ", "this container does not take libx264", "use .mkv")),
        (
            ("--dry-run",),
            "x.webm",
            (
                "x.webm: ",
                "this container does not take libx264",
            ),
        ),
        (("--codec", "dvvideo"), "x.mov", ("x.mov", "dvvideo does not take frames of 64x48 px", "ffv1")),
        (("--codec", "rawvideo"), "x.mov", ("loses the pixel", "ffv1")),
    ],
)
def test_containers_and_encoders_that_do_not_fit_are_refused_before_the_work(
    run: Run, clip: Path, recording: list[object], tmp_path: Path, options, output: str, words
) -> None:
    before = set(tmp_path.iterdir())
    refused(run("video", clip, *recording, *options, "-o", tmp_path / output), *words)
    assert set(tmp_path.iterdir()) == before


def test_colours_that_cannot_be_converted_are_named() -> None:
    frame = av.VideoFrame(WIDTH, HEIGHT, "yuv444p")
    frame.colorspace = 8  # AVCOL_SPC_YCGCO
    with pytest.raises(InputError, match="yuv444p with FFmpeg's colour matrix 8 cannot be converted"):
        values_of(frame)


def test_names_are_no_addresses(
    run: Run, clip: Path, recording: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FFmpeg alone takes what is before a colon for a protocol."""
    monkeypatch.chdir(tmp_path)
    for name in ("10:30:00.mp4", "tcp:localhost:1", "http:", "concat:a|b", os.fsdecode(b"fr\xe9.mp4")):
        shutil.copy(clip, name)
        assert len(open_clip(name)) == FRAMES
    result = run("video", name, *recording, "-o", "10:30.mp4")
    assert result.exit_code == 0, result.output
    assert len(open_clip("10:30.mp4")) == FRAMES


NO_VIDEOS: dict[str, tuple[Callable[[Path], object], str]] = {
    "m3u8": (
        lambda path: path.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:1,\n{path.parent}/clip.mp4\n"),
        "not a video in a container that is read",
    ),
    "concat": (lambda path: path.write_text("ffconcat version 1.0\nfile clip.mp4\n"), "not a video in a container"),
    "jpeg": (lambda path: Image.new("RGB", (8, 8)).save(path, format="JPEG"), "not a video: it looks like a picture"),
    "pipe": (os.mkfifo, "it is a pipe or a device"),
    "empty": (Path.touch, "cannot read the video"),
}


@pytest.mark.parametrize("kind", NO_VIDEOS)
def test_what_is_no_video_is_refused_in_a_line(run: Run, recording: list[object], tmp_path: Path, kind: str) -> None:
    make, message = NO_VIDEOS[kind]
    path = tmp_path / f"a.{kind}"
    make(path)
    refused(run("video", path, *recording, "-o", tmp_path / "o.mp4"), path, message)


def brightness(path: Path, first: int, stop: int) -> list[float]:
    return [frame.to_ndarray(format="gray").mean() for frame in frames(open_clip(path), first, stop)]


def test_transport_streams_are_read_from_any_frame(tmp_path: Path) -> None:
    """Seeking in them ends behind the place where the first group of pictures, or a later one, starts."""
    path = tmp_path / "a.ts"
    write(path, count=30)
    assert len(open_clip(path)) == 30
    levels = np.array(brightness(path, 0, 30))
    assert (np.diff(levels) > 0).all()
    for first in range(0, 30, 3):
        assert brightness(path, first, first + 2) == levels[first : first + 2].tolist()


@pytest.mark.parametrize(
    ("source", "target", "codec"),
    [("mp4", "mov", "libx264"), ("mp4", "mkv", "libvpx-vp9")],
)
def test_pixels_that_are_not_square_stay_so(
    run: Run, recording: list[object], tmp_path: Path, source: str, target: str, codec: str
) -> None:
    path, out = tmp_path / f"a.{source}", tmp_path / f"o.{target}"
    write(path, sample_aspect_ratio=Fraction(4, 3))
    result = run("video", path, *recording, "--codec", codec, "-o", out)
    assert result.exit_code == 0
    with av.open(str(out)) as written:
        is_kept = written.streams.video[0].sample_aspect_ratio == Fraction(4, 3)
    # VP9 has it in its container, which PyAV does not write.
    assert is_kept == (codec != "libvpx-vp9")


def test_a_video_that_cannot_be_decoded_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuvj420p"
        container.start_encoding()
        packet = av.Packet(b"no picture")
        packet.stream, packet.pts, packet.dts, packet.is_keyframe = stream, 0, 0, True
        container.mux(packet)
    with pytest.raises(FileFormatError, match=r"a\.mkv: (no frame of the video can be decoded|cannot read the video)"):
        open_clip(path)
