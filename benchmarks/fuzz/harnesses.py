"""Harnesses for coverage-guided fuzzing: what each does with an input, and small valid inputs to begin with."""

from __future__ import annotations

import shutil
import tempfile
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from io import StringIO
from itertools import chain
from pathlib import Path

import click
import numpy as np

from benchmarks.fuzz import packets, refused, seeds
from benchmarks.fuzz.targets import TARGETS, WRITTEN
from rsdeblur.cli._items import Item, read_items
from rsdeblur.cli._options import Defaults
from rsdeblur.cli.deblur import command as deblur
from rsdeblur.errors import LONGEST_MESSAGE, FileFormatError, RsdeblurError
from rsdeblur.io import directories, read_camera, read_captures
from rsdeblur.io.cameras import write_time_offset
from rsdeblur.io.clocks import is_clocks, read_clocks
from rsdeblur.io.exif import Exif
from rsdeblur.io.exif_times import capture_time, on_clock_of, shown_time
from rsdeblur.io.gyro_logs import FORMATS as GYRO_FORMATS
from rsdeblur.io.gyro_logs import open_gyro
from rsdeblur.io.history import file_facts, with_history
from rsdeblur.io.kernels import read_psfs
from rsdeblur.io.picture_output import write_picture
from rsdeblur.io.pictures import Picture, read_picture
from rsdeblur.io.sessions import indices_of
from rsdeblur.io.source import Source
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import GyroLog

# Shape of the picture that PSFs are read for, px.
SHAPE = (48, 64)


@dataclass(frozen=True, slots=True)
class Harness:
    """A reader, or another function of a file's content.

    Parameters
    ----------
    use : callable
        Takes the path of the input. It may raise nothing but `RsdeblurError`, and asserts what must hold.
    seeds : callable
        Makes valid inputs.
    name : str
        Name of the file that contains the input.
    """

    use: Callable[[Path], None]
    seeds: Callable[[], Sequence[bytes]]
    name: str = "input"


@cache
def _folder() -> Path:
    """Return a folder for the files of this process."""
    return Path(tempfile.mkdtemp(prefix="rsdeblur-fuzz-"))


def try_one(harness: Harness, data: bytes) -> None:
    """Use one input; AssertionError or another exception is a finding."""
    folder = _folder()
    path = folder / harness.name
    path.write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", category=RuntimeWarning, module="rsdeblur")
            harness.use(path)
    except RsdeblurError as error:
        message = str(error)
    else:
        return
    assert str(folder) in message, f"the message does not name the file: {message}"
    assert len(message) <= LONGEST_MESSAGE + len("..."), f"the message has {len(message)} characters"


def _each(*uses: Callable[[Path], object]) -> Callable[[Path], None]:
    """Return a function that reads a file in all ways, and raises the last refusal."""

    def use(path: Path) -> None:
        refusal = None
        for each in uses:
            try:
                each(path)
            except RsdeblurError as error:
                refusal = error
        if refusal is not None:
            raise refusal

    return use


def _logs(path: Path) -> None:
    try:
        TARGETS["plain"].read(path)
    except FileFormatError as error:
        if "--rate" not in str(error):
            raise
        TARGETS["unstamped"].read(path)


def _payload(path: Path) -> None:
    """Read a log that is packed into a zip archive or a project: the last byte of the input says which."""
    data = path.read_bytes()
    packers = (
        seeds.archive,
        partial(seeds.packed_project, key="file_metadata"),
        partial(seeds.packed_project, key="raw_imu"),
    )
    path.write_bytes(packers[data[-1] % len(packers) if data else 0](data[:-1]))
    TARGETS["plain"].read(path)


def _cameras(path: Path) -> None:
    TARGETS["toml"].read(path)
    try:
        camera = Camera.load(path)
    except RsdeblurError:
        return  # a file of another program
    before = path.read_bytes()
    try:
        write_time_offset(path, 0.125)
    except FileFormatError:
        assert path.read_bytes() == before
        return
    assert repr(Camera.load(path)) == repr(replace(camera, time_offset=0.125))


DEFAULTS = Defaults(**dict.fromkeys(Defaults.__slots__))


def _manifest(path: Path) -> None:
    _check_items(read_items(path, replace(DEFAULTS, gyro=path), path.parent, numbered_from=None))


def _check_items(items: Sequence[Item]) -> None:
    outputs = [item.output for item in items if item.error is None]
    assert len(set(outputs)) == len(outputs)
    for item in items:
        assert item.recording is not None or item.error is not None
        assert not item.output.is_absolute()
        assert ".." not in item.output.parts


# What the files of a session contain, by the first word of a line.
CONTENTS = {
    "gyro": seeds.GYRO_TABLES["plain"][0],
    "captures": seeds.CAPTURES["mars-captures"][0],
    "given": seeds.CAPTURES["mars-captures"][0],
    "timestamps": seeds.CAPTURES["timestamps"][0],
    "one": seeds.CAPTURES["image-info"][0],
    "photo": b"",
}


def _session(path: Path) -> None:
    """Read the items of a folder; the input's lines are kinds and names of its files, or settings."""
    folder = path.with_name("session")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    defaults, numbered_from = replace(DEFAULTS, camera=path), None
    for line in path.read_text("latin-1").splitlines()[:20]:
        kind, _, name = line.partition(" ")
        parts = name.split("/")[:3]
        if kind in CONTENTS and not {"", ".", ".."} & {*parts}:
            place = folder.joinpath(*parts)
            with suppress(OSError, ValueError):
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(CONTENTS[kind])
                if kind == "given":
                    defaults = replace(defaults, capture=place)
        elif kind == "exif":
            defaults = replace(defaults, start="exif")
        elif kind == "no-camera":
            defaults = replace(defaults, camera=None)
        elif kind in ("0", "1"):
            numbered_from = int(kind)
    items = read_items(folder, defaults, folder / "out", numbered_from=numbered_from)
    _check_items(items)
    if defaults.capture:
        indices = {photo.index for photo in indices_of([item.photo for item in items], defaults.capture)}
        assert indices <= {None, *range(5)}


def _exif(path: Path) -> None:
    """Read an EXIF block, edit it, and send it through a picture's file."""
    block = path.read_bytes()
    exif = Exif(block)
    with suppress(RsdeblurError):
        exif.focal_px(40, 30)
    _ = exif.exposure, exif.iso, exif.text(271), exif.text(272), shown_time(exif)
    for log in LOGS:
        with suppress(RsdeblurError):
            on_clock_of(capture_time(exif), log)
    turned = directories.read_block(directories.with_orientation(block, 6))
    assert directories.number(turned, directories.ORIENTATION) == 6
    renewed = directories.renewed(block, 5, 4)
    try:
        main = directories.read_block(block)
    except ValueError:
        assert renewed == block
        return
    # What is read and written again is the same; blocks of shared bytes may grow beyond what the format counts.
    again = directories.read_block(directories.block(main))
    assert again.entries == main.entries
    assert again.tables.keys() == main.tables.keys()
    extension = WRITTEN[len(block) % len(WRITTEN)]
    result = path.with_name(f"result{extension}")
    pixels = np.zeros((4, 5, 3), np.uint8) if len(block) % 2 else np.zeros((4, 5), np.float32)
    try:
        write_picture(result, pixels, like=Picture(pixels, exif=block), force=True)
        read_picture(result)
    except RsdeblurError as error:
        raise AssertionError("a picture with this block cannot be written and read") from error


def _packet(path: Path) -> None:
    """Give an XMP packet to a picture, end its history with an entry, and send it through a picture's file."""
    packet = path.read_bytes()
    picture = Picture(np.zeros((4, 5, 3), np.uint8), xmp=packet, iptc=packet or None)
    result = path.with_name(f"result{WRITTEN[len(packet) % len(WRITTEN)]}")
    try:
        for like in (picture, with_history(picture, file_facts(path))):
            write_picture(result, like.pixels, like=like, force=True)
            read_picture(result)
    except RsdeblurError as error:
        raise AssertionError("a picture with this packet cannot be written and read") from error


def _psfs(path: Path) -> None:
    bank = read_psfs(path, SHAPE)
    assert np.allclose(bank.kernels.sum(axis=(-2, -1)), 1.0, atol=1e-3)


@cache
def _recording() -> list[str]:
    """Return arguments that name a small picture, its log and its camera."""
    folder = _folder()
    (folder / "log.csv").write_bytes(seeds.GYRO_TABLES["plain"][0])
    (folder / "camera.toml").write_bytes(b"width = 64\nheight = 48\nfocal_length = 70.0\nreadout_time = 0.01\n")
    (folder / "photo.png").write_bytes(seeds.encoded("PNG", seeds.picture((*SHAPE, 3), "uint8")))
    return [str(folder / "photo.png"), *("--gyro", str(folder / "log.csv")), *("--camera", str(folder / "camera.toml"))]


CLOCKS = [
    b"# SENSOR_INFO_TIMESTAMP_SOURCE is %s\n1000500 500 1000000\n%s\n" % (name, line)
    for name, line in (
        (b"REALTIME", b"1000900 900 1000000"),
        (b"UNKNOWN", b"1000900 900 1000000"),
        (b"UNKNOWN", b"9000900 900 9000000"),
        (b"UNKNOWN", b"1000900 900 1"),
        (b"UNKNOWN", b"1000900 900"),
    )
]
# A log on the photos' clock, and one that no photo's time is on.
LOGS = [GyroLog(np.arange(100.0), np.zeros((100, 3)), epoch) for epoch in (seeds.EPOCH - 50 * 10**9, 0)]
# Options that name no file and print nothing.
OPTIONS = {
    name: option
    for option in deblur.params
    if isinstance(option, click.Option) and not isinstance(option.type, click.Path)
    for name in option.opts
    if name not in ("--help", "--json", "--dry-run", "--force")
}


def _options(path: Path) -> None:
    """Check a photo with the options of the input's lines: a name and, if it takes one, a value."""
    arguments = [*_recording(), "-o", str(path.with_name("sharp.png")), "--dry-run", "--json"]
    for line in path.read_text("latin-1").splitlines():
        name, _, value = line.partition(" ")
        if (option := OPTIONS.get(name)) is not None:
            arguments += [name] if option.is_flag else [f"{name}={value}"]
    try:
        with redirect_stdout(StringIO()):
            deblur.main(arguments, standalone_mode=False)
    # Messages about options name the argument instead of the file.
    except (RsdeblurError, click.ClickException):
        pass


def _forced(path: Path) -> None:
    """Read a file as a gyro log or camera of a format that it may not have; its size says which."""
    names = [*(each.name for each in GYRO_FORMATS), "none"]
    open_gyro(path, names[path.stat().st_size % len(names)], orientation="YxZ")


def _forced_camera(path: Path) -> None:
    names = ("exif", "gyroflow", "kalibr", "mars", "recording", "toml", "none")
    size = path.stat().st_size
    read_camera(path, names[size % len(names)], size=(360, 640), name=f"cam{size % 3}", focal_length=500.0)


def _renamed(read: Callable[[Path], None], *names: str) -> Callable[[Path], None]:
    """Return a function that reads a file under one of the names, which its size chooses."""
    return lambda path: read(path.replace(path.with_name(names[path.stat().st_size % len(names)])))


def _sized(files: Sequence[bytes]) -> list[bytes]:
    """Return files in so many sizes that each is read under each of the names."""
    return [file + b"\n" * k for file in files for k in range(len(NAMES))]


def _clocks(path: Path) -> None:
    clocks = read_clocks(path)
    assert is_clocks(Source(path, "clocks"))
    assert np.isfinite(clocks.time_offset)


def _of(*names: str) -> Callable[[], Sequence[bytes]]:
    """Return a function that makes the seeds of these targets."""
    return lambda: [*chain.from_iterable(TARGETS[name].seeds() for name in names)]


def _manifests() -> Sequence[bytes]:
    return [
        b"photo,output,gyro,camera,capture,index\na.jpg,b.png,g.csv,c.toml,f.csv,3\nd.heic,,,,,\n",
        b'photo;start;duration;time_offset;readout\n"a;b.png";1/20;50ms;-0.1;3ms\nc.png;0.5;;;\n',
        b"photo,output,camera,start,capture\na.png,,c.toml,exif,\nb.png,a.png,c.toml,exif,f.csv\nc.png,input,c.toml,1,\n",
        b"\xef\xbb\xbfphoto\tgyro_format\tunit\torientation\tstart_ns\trate\tbias\n"
        b"x/../a.png\tplain\tdeg/s\tYxZ\t12345678901\t200\t1,2,3deg/s\n/b.tif\t\t\t\t\t\t0.1,0,0\n",
    ]


def _payloads() -> Sequence[bytes]:
    return [seeds.GYRO_TABLES["sensorlogger"][0] + b"\0", seeds.cbor() + b"\1", seeds.bincode() + b"\2"]


def _psf_files() -> Sequence[bytes]:
    kernel = seeds.encoded("PNG", seeds.picture((5, 4), "uint8"))
    return [seeds.bank(), kernel, *seeds.npys(), *seeds.tiffs()[:3]]


def _settings() -> Sequence[bytes]:
    return [
        b"--start 0.01\n--duration 1/50\n--mode rowwise\n--prior tv\n--weight 0.01\n--threads 2\n",
        b"--start-ns 1766385749437863801\n--duration 20ms\n--bands 3\n--strips auto\n--nsr 1e-3\n--bias 1,0,0deg/s\n",
        b"--start 10ms\n--duration 0.02\n--transfer 2.2\n--noise auto\n--max-memory 1GiB\n--work-size paper\n",
        b"--start 0\n--duration 5ms\n--border zero\n--normalize\n--exponent 0.5\n--time-offset 1ms\n--unit deg/s\n"
        b"--gyro-format plain\n--orientation YxZ\n--readout-time 3ms\n--refine\n--nsr-from-iso\n",
    ]


def _sessions() -> Sequence[bytes]:
    epoch = seeds.EPOCH
    return [
        b"gyro gyro_accel.csv\ncaptures movie_metadata.csv\nstamps frame_timestamps.txt\n"
        b"photo frames/frame_0.png\nphoto frames/frame_9.jpg\nphoto x.heic\nphoto c.toml\n",
        b"gyro imu.txt\nstamps a_timestamps.csv\nphoto IMG_%d.jpg\nphoto b_%d.png\nno-camera x\n" % (epoch, epoch * 2),
        b"gyro gyro.csv\none images.txt\nphoto 1.png\nphoto 2.png\n",
        b"gyro gyro.csv\none images.txt\nphoto 1.png\n1 x\n",
        b"gyro gyro.csv\ngiven t.csv\nphoto 3.png\nphoto 7.dng\n",
        b"gyro a/gyro.csv\nphoto a/1.png\nexif x\n",
        b"given gyro.csv\nphoto a.png\n",
        b"gyro gyro.csv\ngyro b.csv\nphoto a.png\n",
        b"gyro gyro.csv\nstamps b.csv\n",
        b"gyro gyro.csv\nstamps b.csv\nphoto a.png\n",
    ]


VIDEO = tuple(name for name in ("video",) if name in TARGETS)
NAMES = ("input", "TotalAcceleration.csv", "GyroscopeUncalibrated.csv", "clip.mp4")
HARNESSES: dict[str, Harness] = {
    "logs": Harness(
        _renamed(_each(_logs, _forced), *NAMES),
        lambda: [
            *_of(*seeds.GYRO_TABLES, "unstamped", "sensorlogger-json", "gyrodata", "zip-file", "gyroflow")(),
            *_sized(_of("sensorlogger", *VIDEO)()),
            *refused.LOGS,
        ],
    ),
    "payloads": Harness(_payload, _payloads),
    "accelerations": Harness(
        _renamed(TARGETS["acceleration"].read, *NAMES),
        lambda: [*_of("acceleration")(), *_sized([*_of(*VIDEO)(), seeds.ACCELERATIONS[-2]])],
    ),
    "trajectories": Harness(TARGETS["trajectory"].read, _of("trajectory")),
    "captures": Harness(
        _each(TARGETS["timestamps"].read, read_captures, partial(read_captures, duration=0.01), _clocks),
        lambda: [*_of(*seeds.CAPTURES, "gyrodata-captures")(), *CLOCKS, *refused.CAPTURES],
    ),
    "cameras": Harness(
        _each(
            read_camera,
            partial(read_camera, size=(640, 360), sensor_width=4000),
            partial(read_camera, size=(640, 360), focal_length=500.0),
            partial(read_camera, size=(500, 500), fps=30.0),
            _forced_camera,
            _cameras,
        ),
        lambda: [
            *_of("toml", "kalibr", "gyroflow-lens", "mars-captures", "gcsv")(),
            *_sized(_of(*VIDEO)()),
            *(seeds.jpeg(block) for block in packets.exifs()),
            *refused.CAMERAS,
        ],
    ),
    "manifest": Harness(_manifest, _manifests),
    "sessions": Harness(_session, _sessions),
    "exif": Harness(_exif, packets.exifs),
    "packets": Harness(_packet, lambda: packets.PACKETS),
    "psfs": Harness(_psfs, _psf_files),
    "options": Harness(_options, _settings),
    # One in four is read as a raw file of TIFF's structure, if it is TIFF.
    "pictures": Harness(
        _renamed(TARGETS["png"].read, *["input"] * 3, "a.nef"),
        lambda: [*_of("jpeg", "png", "webp", "tiff", "npy", "heic", "dng")(), *refused.pictures()],
    ),
    "mapped": Harness(TARGETS["mapped"].read, lambda: [*_of("mapped")(), *refused.arrays()]),
}
