"""Hostile files: a reader reads them, or refuses them in one message that names the file.

Damaged files of every format, and a test for every fault that long runs have found: `RSDEBLUR_HOSTILE` is the number of
damaged files of each format.
"""

from __future__ import annotations

import json
import os
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from rsdeblur import Camera
from rsdeblur.errors import FileFormatError, RsdeblurError
from rsdeblur.io import (
    open_camera,
    open_gyro,
    read_acceleration,
    read_captures,
    read_gyro,
    read_picture,
    read_trajectory,
)
from rsdeblur.io.pictures import check_scans
from rsdeblur.psf import PsfBank
from tests._util import files
from tests.hostile import targets
from tests.installed import needs

READERS: dict[str, Callable[[Path], Any]] = {
    "gyro": open_gyro,
    "acceleration": read_acceleration,
    "trajectory": read_trajectory,
    "camera": open_camera,
    "toml": Camera.load,
    "captures": read_captures,
    "picture": read_picture,
    "bank": PsfBank.load,
}
# Number of inputs per target; each takes a few milliseconds.
INPUTS = int(os.environ.get("RSDEBLUR_HOSTILE", "25"))


@pytest.fixture(params=READERS.values(), ids=READERS)
def read(request: pytest.FixtureRequest) -> Callable[[Path], Any]:
    return request.param


def refuses(read: Callable[[Path], Any], path: Path) -> bool:
    """Return whether a file is refused; the message must name the file, or one that was to be written beside it."""
    error = None
    try:
        read(path)
    except RsdeblurError as caught:
        error = caught
    assert error is None or str(path.parent) in str(error)
    return error is not None


def refusal(read: Callable[[Path], Any], path: Path) -> str:
    with pytest.raises(RsdeblurError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


# Extras that write or read these formats.
EXTRAS = {
    "gyroflow": "gyroflow",
    "gyroflow-cbor": "gyroflow",
    "heic": "heif",
    "dng": "raw",
    "kalibr": "kalibr",
}


@pytest.mark.parametrize("name", targets.TARGETS)
def test_spoilt_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    if name in EXTRAS:
        needs(EXTRAS[name])
    target = targets.TARGETS[name]
    path = tmp_path / target.name
    refused = 0
    with warnings.catch_warnings():
        # Warnings of libraries about the files do not matter; computing with NaN or overflowing numbers does.
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", category=RuntimeWarning, module="rsdeblur")
        for content in target.seeds():
            path.write_bytes(target.pack(content) if target.pack else content)
            target.read(path)
        for number in range(INPUTS):
            path.write_bytes(target.spoilt(number))
            refused += refuses(target.read, path)
    # The mutations have an effect; but a picture is read even without its EXIF block.
    assert refused or name == "jpeg-exif"


@settings(derandomize=True, deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
def test_any_bytes_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    for read in READERS.values():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            refuses(read, path)


def set_tag(data: bytearray, tag: int, value: int) -> None:
    """Replace a number in the directory of a TIFF."""
    place = data.index(struct.pack("<HHI", tag, 4, 1)) + 8
    data[place : place + 4] = struct.pack("<I", value)


class TestPlaces:
    """Everything that is not a regular file is refused at once, without waiting for data."""

    def test_pipe(self, read: Callable[[Path], Any], tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe")
        assert "a pipe or a device" in refusal(read, tmp_path / "pipe")

    def test_endless_device(self, read: Callable[[Path], Any]) -> None:
        assert "a pipe or a device" in refusal(read, Path("/dev/zero"))

    def test_folder(self, read: Callable[[Path], Any], tmp_path: Path) -> None:
        assert "it is a folder" in refusal(read, tmp_path)

    def test_link_to_nothing_or_to_itself(self, read: Callable[[Path], Any], tmp_path: Path) -> None:
        (tmp_path / "nothing").symlink_to("nowhere")
        (tmp_path / "loop").symlink_to("loop")
        assert "No such file" in refusal(read, tmp_path / "nothing")
        assert "Too many levels" in refusal(read, tmp_path / "loop")

    @pytest.mark.parametrize("name", ["a\0b", "a\ud800b"])
    def test_names_that_no_file_has(self, read: Callable[[Path], Any], tmp_path: Path, name: str) -> None:
        assert "cannot read" in refusal(read, tmp_path / name)

    @pytest.mark.parametrize("name", ["a\nb.csv", "a b'\".csv", "-rf.csv", "\udcff.csv", "é😀.csv", "x" * 250 + ".csv"])
    def test_odd_names(self, tmp_path: Path, name: str) -> None:
        path = tmp_path / name
        path.write_bytes(files.GYRO_TABLES["plain"][0])
        assert len(read_gyro(path)) == len(files.RATES)
        path.write_bytes(b"nothing")
        refusal(read_gyro, path)


class TestText:
    @pytest.mark.parametrize("mark", ["[", "(", " ", "1", "[]", "a,", "1e", "\t"])
    def test_long_lines_take_no_long_time(self, tmp_path: Path, mark: str) -> None:
        # Patterns that backtrack would take hours.
        path = tmp_path / "log.csv"
        path.write_text(f"t,gx,gy,gz\n0,{mark * 100_000}x,2,3\n" + f"{mark * 100_000}x\n" * 3)
        refusal(open_gyro, path)
        path.write_text("a: 1" + "\n" * 100_000)
        refusal(open_camera, path)

    @pytest.mark.parametrize("time", ["1e300", "9.3e12", "-9.3e12"])
    def test_timestamps_of_projects_beyond_int64(self, tmp_path: Path, time: str) -> None:
        path = tmp_path / "a.gyroflow"
        samples = [{"timestamp_ms": 0, "gyro": [1, 2, 3]}, {"timestamp_ms": float(time), "gyro": [1, 2, 3]}]
        path.write_text(json.dumps({"raw_imu": samples}))
        assert "sample 1: timestamp" in refusal(open_gyro, path)


class TestNumbersOfCameras:
    @pytest.mark.parametrize(
        "line",
        [
            "width = " + "9" * 5000,
            "focal_length = 1e300",
            "principal_point = [1e308, -1e308]",
            "readout_time = " + "[" * 5000,
            "imu_to_camera = [[1e200, 0, 0], [0, 1e200, 0], [0, 0, 1e200]]",
            'distortion_model = "fisheye"\ndistortion = [1e308, 1e308, 1e308, 1e308]',
        ],
        ids=lambda line: line[:25],
    )
    def test_refused(self, tmp_path: Path, line: str) -> None:
        path = tmp_path / "camera.toml"
        key = line.split()[0]
        whole = {"width": "width = 640", "height": "height = 480", "focal_length": "focal_length = 500"}
        path.write_text("\n".join([line, *(text for name, text in whole.items() if name != key)]))
        refusal(Camera.load, path)


@pytest.mark.parametrize("crop", [5e-324, 1e300, float("inf")])
def test_crops_of_lens_profiles(tmp_path: Path, crop: float) -> None:
    path = tmp_path / "lens.json"
    path.write_text(json.dumps(files.PROFILE | {"crop": crop}))
    assert "the profile's crop is" in refusal(open_camera, path)


class TestYaml:
    @pytest.fixture(autouse=True)
    def reader(self) -> None:
        needs("kalibr")

    CAMERA = "cam0: {camera_model: pinhole, intrinsics: %s, resolution: [640, 480], distortion_model: none}\n"

    @pytest.mark.parametrize(
        ("first", "next_one", "levels"),
        [
            ("[1, 2, 3, 4]", "[{}]", 60),
            ("{k: 1}", "{{<<: [{}]}}", 12),
            ("[*a0]", "[{}]", 0),
        ],
        ids=["lists", "merged", "holds itself"],
    )
    def test_billion_laughs(self, tmp_path: Path, first: str, next_one: str, levels: int) -> None:
        path = tmp_path / "camera.yaml"
        laughs = f"a0: &a0 {first}\n" + "".join(
            f"a{i + 1}: &a{i + 1} {next_one.format(', '.join([f'*a{i}'] * 9))}\n" for i in range(levels)
        )
        path.write_text(laughs + self.CAMERA % "[1, 2, 3, 4]")
        assert "more than 10000 values" in refusal(open_camera, path)

    def test_an_alias_is_read(self, tmp_path: Path) -> None:
        path = tmp_path / "camera.yaml"
        path.write_text("k: &k [500, 500, 320, 240]\n" + self.CAMERA % "*k")
        assert open_camera(path).camera.focal_length == (500.0, 500.0)

    def test_nothing_is_built_or_called(self, tmp_path: Path) -> None:
        path = tmp_path / "camera.yaml"
        path.write_text(self.CAMERA % f"!!python/object/apply:os.mkdir [{tmp_path / 'made'}]")
        assert "could not determine a constructor" in refusal(open_camera, path)
        assert not (tmp_path / "made").exists()

    @pytest.mark.parametrize("text", ["[" * 600, "{a: " * 600, "- " * 600, "a: 1\n" * 50_000])
    def test_deep_or_long(self, tmp_path: Path, text: str) -> None:
        path = tmp_path / "camera.yaml"
        path.write_text("cam0: " + text)
        refusal(open_camera, path)


@pytest.mark.parametrize("nest", ["[", '{"a":'])
def test_deep_json(tmp_path: Path, nest: str) -> None:
    path = tmp_path / "a.gyroflow"
    path.write_text('{"raw_imu": ' + nest * 100_000)
    for read in (open_gyro, open_camera):
        refusal(read, path)


class TestBombs:
    """Files that unpack to far more than their size are refused before they are unpacked."""

    def test_zip(self, tmp_path: Path) -> None:
        path = tmp_path / "a.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("gyro.csv", bytes(70_000_000))
        assert "claims to contain 70000000 bytes" in refusal(open_gyro, path)

    def test_zip_that_claims_little(self, tmp_path: Path) -> None:
        path = tmp_path / "a.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("gyro.csv", bytes(70_000_000))
        path.write_bytes(path.read_bytes().replace(struct.pack("<I", 70_000_000), struct.pack("<I", 100)))
        refusal(open_gyro, path)

    @pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
    def test_zip_of_denser_methods(self, tmp_path: Path, method: int) -> None:
        path = tmp_path / "a.zip"
        with zipfile.ZipFile(path, "w", method) as archive:
            archive.writestr("gyro.csv", b"0 1 2 3\n")
        assert "other than deflate" in refusal(open_gyro, path)

    def test_zip_whose_names_lead_elsewhere(self, tmp_path: Path) -> None:
        (tmp_path / "secret.csv").write_bytes(files.GYRO_TABLES["plain"][0])
        path = tmp_path / "a.zip"
        for name in (f"{tmp_path}/secret.csv", "../secret.csv"):
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr(name, b"\0\0\0\x18ftypmp42")
            assert "a.zip" in refusal(open_gyro, path)

    def test_project(self, tmp_path: Path) -> None:
        path = tmp_path / "a.gyroflow"
        payload = files.base91(zlib.compress(bytes(70_000_000)))
        path.write_text(json.dumps({"title": "Gyroflow data file", "gyro_source": {"raw_imu": payload}}))
        assert "unpack to more than" in refusal(open_gyro, path)

    def test_pictures_of_few_bytes_and_many_pixels(self, tmp_path: Path) -> None:
        path = tmp_path / "a"
        header = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 20_000, 20_000, 8, 2, 0, 0, 0)
        path.write_bytes(header + struct.pack(">I", zlib.crc32(header[12:])) + b"\0\0\0\0IEND\xae\x42\x60\x82")
        assert "exceeds limit" in refusal(read_picture, path)
        tifffile.imwrite(path, np.zeros((10, 10), np.uint8))
        data = bytearray(path.read_bytes())
        for tag in (256, 257):
            set_tag(data, tag, 20_000)
        path.write_bytes(data)
        assert "claims 20000x20000 pixels" in refusal(read_picture, path)

    @pytest.mark.parametrize(("scans", "allowed"), [(90, True), (100, False), (20_000, False)])
    def test_jpeg_of_many_scans(self, tmp_path: Path, scans: int, allowed: bool) -> None:
        # Scans take 50 bytes each: with them, decoding 64 megapixels from a file of 1 MB would take minutes.
        path = tmp_path / "a.jpg"
        Image.new("L", (64, 64)).save(path, progressive=True)
        data = path.read_bytes()
        last = data.rindex(b"\xff\xda")
        scan = data[last : data.rindex(b"\xff\xd9")]
        path.write_bytes(data[:last] + scan * scans + data[last:])
        if allowed:
            assert read_picture(path).pixels.shape == (64, 64)
        else:
            assert "more than 100 scans" in refusal(read_picture, path)

    @pytest.mark.parametrize(("side", "allowed"), [(5000, 40), (8000, 15), (9000, 12), (65000, 12)])
    def test_jpeg_of_more_scans_than_its_size_allows(self, side: int, allowed: int) -> None:
        frame = b"\xff\xc2\x00\x0b\x08" + 2 * side.to_bytes(2, "big") + b"\x01\x01\x11\x00"
        scan = b"\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00\x55"
        check_scans(b"\xff\xd8" + frame + allowed * scan + b"\xff\xd9")
        with pytest.raises(ValueError, match=f"more than {allowed} scans"):
            check_scans(b"\xff\xd8" + frame + (allowed + 1) * scan + b"\xff\xd9")

    def test_a_small_tiff_of_many_pixels(self, tmp_path: Path) -> None:
        path = tmp_path / "a.tif"
        tifffile.imwrite(path, np.zeros((5000, 5000), np.uint8), compression="zstd")
        assert "claims 5000x5000 pixels" in refusal(read_picture, path)

    def test_a_tiff_of_a_slow_codec_needs_more_bytes(self, tmp_path: Path) -> None:
        path = tmp_path / "a.tif"
        for codec in ("jpegxl", "jpeg2000"):
            tifffile.imwrite(path, np.zeros((64, 64), np.uint8), compression=codec)
            with tifffile.TiffFile(path, mode="r+b") as file:
                file.pages.first.tags["ImageWidth"].overwrite(8000)
                file.pages.first.tags["ImageLength"].overwrite(8000)
            with path.open("ab") as padding:
                padding.write(bytes(70_000))
            assert "claims 8000x8000 pixels" in refusal(read_picture, path)

    def test_tiff_whose_parts_share_their_bytes(self, tmp_path: Path) -> None:
        path = tmp_path / "a.tif"
        tifffile.imwrite(path, np.zeros((64, 64), np.uint8), rowsperstrip=8)
        with tifffile.TiffFile(path, mode="r+b") as file:
            tag = file.pages.first.tags["StripOffsets"]
            tag.overwrite([tag.value[0]] * len(tag.value))
            tag = file.pages.first.tags["StripByteCounts"]
            tag.overwrite([512] * len(tag.value))
        data = path.read_bytes()
        path.write_bytes(data[: len(data) - 3000])
        assert "a.tif: the picture is truncated or damaged" in refusal(read_picture, path)

    def test_tiff_of_millions_of_parts(self, tmp_path: Path) -> None:
        path = tmp_path / "a.tif"
        tifffile.imwrite(path, np.zeros((3, 2), np.uint16), rowsperstrip=1)
        data = bytearray(path.read_bytes())
        set_tag(data, 257, 7_500_000)
        path.write_bytes(data)
        assert "more than the file has bytes" in refusal(read_picture, path)

    @pytest.mark.parametrize("in_place", [False, True])
    def test_tiff_whose_width_is_a_list(self, tmp_path: Path, in_place: bool) -> None:
        """500 widths times a height of 10^6 would take 4 GB."""
        path = tmp_path / "a.tif"
        tifffile.imwrite(path, np.zeros((3, 2), np.uint8))
        with tifffile.TiffFile(path, mode="r+b") as file:
            tags = file.pages.first.tags
            tags["ImageLength"].overwrite(10**6)
            tags["ImageWidth"].overwrite([2] * 500)
        with pytest.raises(FileFormatError, match="imagewidth is not a number"):
            read_picture(path, in_place=in_place)


class TestDamagedPictures:
    def test_a_damaged_tiff_prints_nothing(self, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
        path = tmp_path / "a.tif"
        path.write_bytes(b"II*\0\x08\0\0\0\x02\0" + b"\x01\x63" * 30)
        refusal(read_picture, path)
        assert capfd.readouterr().err == ""


def test_errors_are_files_errors(read: Callable[[Path], Any], tmp_path: Path) -> None:
    with pytest.raises(FileFormatError):
        read(tmp_path / "none")
