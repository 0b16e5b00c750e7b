"""`rsdeblur video`: frames get sharper, and everything else is kept."""

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

from rsdeblur import Camera, Correction, Exposure, simulate
from rsdeblur.estimate import Refinement
from rsdeblur.image.transfer import from_linear
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake
from tests.cli.clips import write_clip
from tests.installed import needs

av = needs("video")

Run = Callable[..., Result]

WIDTH, HEIGHT, FRAMES = 112, 80, 10
TICK = Fraction(1, 90000)
START, DURATION = 0.05, 1 / 30  # s
# Uneven intervals between frames, like those of a phone in poor light.
TIMESTAMPS = [3000 * i + 700 * (i % 3) for i in range(FRAMES)]


# The scene is sharp to the pixel, but automatic strengths assume the softness of a lens.
STRENGTHS = ("--nsr", 0.1)


class Movie(NamedTuple):
    """Files of a short video, and the sharp frames."""

    path: Path
    gyro: Path
    camera: Path
    truth: list[NDArray[np.float32]]

    def arguments(self, *more: object) -> list[object]:
        """Return the arguments of every call, and `more`."""
        sources = ["--gyro", self.gyro, "--camera", self.camera, "--jobs", 2, "--crf", 4, "--above", 0]
        return ["video", self.path, *sources, *more]

    @property
    def stamped(self) -> list[object]:
        """Options for the exposures of the frames."""
        return ["--start", START, "--duration", DURATION]


@pytest.fixture(scope="module")
def movie(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    """Film a scene with a shaking rolling-shutter camera held upright, with sound."""
    folder = tmp_path_factory.mktemp("movie")
    log = hand_shake(0.6, strength=0.3, seed=3)
    camera = Camera(WIDTH, HEIGHT, 1.1 * WIDTH, readout_time=0.02)
    sharp = scene(HEIGHT + 40, WIDTH + 40, seed=1)
    taken = [simulate(sharp, log, camera, Exposure(START + float(t * TICK), DURATION)) for t in TIMESTAMPS]
    blurred, truth = (
        [from_linear(getattr(capture, name).clip(0, 1), "srgb") for capture in taken] for name in ("blurred", "rolling")
    )
    files = Movie(folder / "clip.mp4", folder / "gyro.csv", folder / "camera.toml", truth)
    camera.save(files.camera)
    np.savetxt(files.gyro, np.column_stack([log.t, log.omega]), "%.9f", ",", header="t,wx,wy,wz", comments="")
    write(files.path, blurred)
    return files


def write(path: Path, pictures: list[NDArray[np.float32]], *, tagged: bool = True, pixels: str = "yuv420p") -> None:
    """Encode display values as H.264, with sound."""
    facts = {"tagged": tagged, "turn": -90 if tagged else 0, "max_b_frames": 2}
    write_clip(path, pictures, pixels=pixels, tick=TICK, times=TIMESTAMPS, sound=True, **facts)


class Seen(NamedTuple):
    """Pictures, properties and sound of a file."""

    pictures: list[NDArray[Any]]
    kept: dict[str, Any]
    sound: list[bytes]


def seen(path: Path) -> Seen:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = list(container.decode(stream))
        kept = {
            "timestamps": [float(frame.pts * stream.time_base) for frame in frames],
            "turn": frames[0].rotation,
            "codec": stream.codec_context.name,
            "tags": [
                *(int(frames[0].color_range), int(frames[0].colorspace)),
                *(int(stream.codec_context.color_primaries), int(stream.codec_context.color_trc)),
            ],
            # The edit list of the original counts in ms.
            "length": round(float((stream.start_time + stream.duration) * stream.time_base), 2),
        }
        pictures = [frame.reformat(format="rgb48le", dst_color_range=2).to_ndarray() / 65535 for frame in frames]
    with av.open(str(path)) as container:
        sound = [bytes(packet) for packet in container.demux(container.streams.audio) if packet.size]
    return Seen(pictures, kept, sound)


def similarity(pictures: list[NDArray[Any]], truth: list[NDArray[np.float32]]) -> float:
    """Return the mean PSNR away from the borders, dB."""
    errors = (np.array(truth) - np.array(pictures))[:, 12:-12, 12:-12] ** 2
    return float(-10 * np.log10(errors.mean(axis=(1, 2, 3))).mean())


@pytest.mark.parametrize("method", [(), ("--mode", "rowwise")])
def test_frames_get_sharper_and_all_else_is_kept(
    run: Run, movie: Movie, tmp_path: Path, method: tuple[str, ...]
) -> None:
    result = run(*movie.arguments(*movie.stamped, *STRENGTHS, *method, "-o", tmp_path / "sharp.mp4"))
    assert result.exit_code == 0, result.output
    before, after = seen(movie.path), seen(tmp_path / "sharp.mp4")
    assert after.kept == before.kept
    assert after.kept["timestamps"] == [float(t * TICK) for t in TIMESTAMPS]
    assert after.kept["turn"] == -90
    assert after.sound == before.sound
    assert len(after.sound) > 10
    # Measured 1.2 dB: 4:2:0 stores only a quarter of the colour samples.
    assert similarity(after.pictures, movie.truth) > similarity(before.pictures, movie.truth) + 0.8


def test_captures_give_the_exposure_of_each_frame(run: Run, movie: Movie, tmp_path: Path) -> None:
    captures = tmp_path / "movie_metadata.csv"
    rows = [f"{round(1e9 * (START + float(t * TICK)))},{round(1e9 * DURATION)}" for t in TIMESTAMPS]
    # One capture was not encoded, as the list of encoded frames shows.
    captures.write_text("Timestamp[nanosec],Exposure time[nanosec]\n" + "\n".join(["1000,33333333", *rows]) + "\n")
    encoded = [str(int(row.split(",")[0]) // 1000 * 1000) for row in rows]
    (tmp_path / "frame_timestamps.txt").write_text("\n".join(encoded) + "\n")
    assert run(*movie.arguments("--capture", captures, "-o", tmp_path / "a.mp4")).exit_code == 0
    assert run(*movie.arguments(*movie.stamped, "-o", tmp_path / "b.mp4")).exit_code == 0
    a, b = (seen(tmp_path / name).pictures for name in ("a.mp4", "b.mp4"))
    # Timestamps are rounded to ns, which changes few values of 8 bits.
    assert np.abs(np.array(a) - np.array(b)).mean() < 1e-3
    (tmp_path / "frame_timestamps.txt").write_text("\n".join(encoded[:-1]) + "\n")
    result = run(*movie.arguments("--capture", captures, "-o", tmp_path / "c.mp4"))
    assert result.exit_code == 1
    assert f"the file lists {FRAMES - 1} frames, but {movie.path} has {FRAMES}" in result.stderr


@pytest.mark.parametrize(("tagged", "pixels"), [(False, "yuv420p"), (True, "yuvj420p")])
def test_colours_stay(run: Run, movie: Movie, tmp_path: Path, tagged: bool, pixels: str) -> None:
    # With a camera at rest, the output equals the input for every matrix and range.
    smooth = np.linspace(0.2, 0.8, WIDTH)[None, :, None] * np.array([1.0, 0.6, 0.3]) * np.ones((HEIGHT, 1, 1))
    path, still = tmp_path / "still.mp4", tmp_path / "still.csv"
    write(path, [smooth.astype(np.float32)] * FRAMES, tagged=tagged, pixels=pixels)
    np.savetxt(still, np.column_stack([np.arange(0, 1, 0.005), np.zeros((200, 3))]), "%.6f", ",")
    calm = movie._replace(path=path, gyro=still)
    result = run(*calm.arguments(*movie.stamped, "-o", tmp_path / "out.mp4"))
    assert result.exit_code == 0, result.output
    before, after = seen(path), seen(tmp_path / "out.mp4")
    assert after.kept == before.kept
    # Two steps of 8 bits: two more roundings of YCbCr.
    assert np.abs(np.array(before.pictures) - np.array(after.pictures)).mean() < 2 / 255


def test_frames_beyond_the_log_are_kept(run: Run, movie: Movie, tmp_path: Path) -> None:
    short = tmp_path / "short.csv"
    lines = movie.gyro.read_text().splitlines()
    short.write_text("\n".join(lines[:45]) + "\n")  # 0.22 s
    cut = movie._replace(gyro=short)
    result = run(*cut.arguments(*movie.stamped, "--json", "-o", tmp_path / "out.mp4"))
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert 0 < facts["kept"] < FRAMES
    assert f"{facts['kept']} of {FRAMES} frames are kept as they are" in result.stderr
    before, after = seen(movie.path).pictures, seen(tmp_path / "out.mp4").pictures
    assert similarity(after[-1:], before[-1:]) > 35  # encoded once more
    short.write_text("\n".join(lines[:4]) + "\n")
    result = run(*cut.arguments(*movie.stamped, "-o", tmp_path / "none.mp4"))
    assert result.exit_code == 1
    assert "does not cover the exposure" in result.stderr


def test_the_number_of_frames_at_a_time_changes_nothing(run: Run, movie: Movie, tmp_path: Path) -> None:
    pictures = []
    for jobs in (1, 3):
        # Lossless: the bits of other encoders depend on their threads.
        out = tmp_path / f"{jobs}.mkv"
        assert run(*movie.arguments(*movie.stamped, "--codec", "ffv1", "--jobs", jobs, "-o", out)).exit_code == 0
        with av.open(str(out)) as container:
            pictures.append([frame.to_ndarray() for frame in container.decode(video=0)])
    np.testing.assert_array_equal(*pictures)


def test_frames_together_correct_the_recording(
    run: Run, movie: Movie, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def blur(*more: str) -> tuple[float, Any]:
        command = movie.arguments(*movie.stamped, "--dry-run", "--json", "-o", tmp_path / "out.mov")
        facts = json.loads(run(*command, *more).stdout)
        return facts["largest_blur_px"], facts["refinement"]

    def correction(images: object, log: Any, camera: Camera, exposures: list[Exposure], **_: object) -> Any:
        assert len(list(images)) == len(exposures) > 1
        corrected = replace(camera, time_offset=4e-3)
        facts = True, "", Correction(offset=4e-3), Correction(), 0.9, 50.0, 0.02
        return [Refinement(log, corrected, each, None, *facts) for each in exposures]

    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", correction)
    plain, corrected = blur(), blur("--refine")
    assert plain[1] is None
    assert corrected[1]["accepted"]
    assert corrected[0] != plain[0]  # another clock, other blur
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("more", "code", "message"),
    [
        (("-o", "x.avi", "--duration", "0.01"), 1, "unknown video extension '.avi'"),
        (("-o", "x.mp4"), 2, "the exposure time is not given"),
        (("-o", "x.mp4", "--duration", "0.01", "--start", "1", "--start-ns", "1"), 2, "exclude each other"),
        (("-o", "x.mp4", "--duration", "0.01", "--saturation", "always"), 2, "No such option"),
        (("-o", "x.mp4", "--duration", "0.01", "--codec", "aac"), 1, "no video encoder called 'aac'"),
    ],
)
def test_refusals(
    run: Run, movie: Movie, tmp_path: Path, monkeypatch: Any, more: tuple[str, ...], code: int, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*movie.arguments(*more))
    assert result.exit_code == code
    assert message in " ".join(result.stderr.split())
    assert not list(tmp_path.iterdir())
