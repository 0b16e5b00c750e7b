"""Camera files of other programs: numbers, axes, clocks and lens as each defines them, or a refusal with its reason."""

import json
import math
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsdeblur import Camera, FileFormatError, InputError, RsdeblurWarning, read_camera
from rsdeblur.io import open_camera
from rsdeblur.io.cameras import write_time_offset
from rsdeblur.io.gyro_binary import frame_exposures
from rsdeblur.motion.axes import imu_to_camera
from tests._util import files, gyroflow
from tests.installed import needs

Write = Callable[..., Path]


# Changes of a lens profile, and what its camera then has.
PROFILES: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({}, {"width": 400, "height": 300, "focal_length": (210.0, 211.0), "distortion_model": "fisheye"}),
    ({}, {"distortion": (0.05, -0.02, 0.01, -0.003), "readout_time": 0.015, "readout_direction": "top-down"}),
    ({}, {"timestamp_marks": "middle", "principal_point": (199.5, 149.5)}),
    ({"asymmetrical": True}, {"principal_point": (190.0, 160.0)}),
    (
        {"distortion_model": "opencv_standard"},
        {"distortion_model": "radtan", "distortion": (0.05, -0.02, 0.01, -0.003)},
    ),
    ({"crop": 1.25}, {"focal_length": (168.0, 168.8)}),
    *(
        (
            {"frame_readout_time": time, "frame_readout_direction": word},
            {"readout_time": abs(time) / 1000, "readout_direction": direction, "readout_sd": 0.0},
        )
        for time, word, direction in (
            (-15.0, None, "bottom-up"),
            (15.0, "BottomToTop", "bottom-up"),
            (15.0, "LeftToRight", "left-right"),
            (-15.0, "RightToLeft", "right-left"),
        )
    ),
    # Unknown: a guess that refinement corrects.
    ({"frame_readout_time": None}, {"readout_time": 0.02, "readout_sd": 0.01}),
]


class TestLensProfile:
    @pytest.mark.parametrize(("changes", "expected"), PROFILES)
    def test_values(self, write: Write, changes: dict[str, Any], expected: dict[str, Any]) -> None:
        file = open_camera(write(files.lens(**changes)))
        assert {name: getattr(file.camera, name) for name in expected} == expected
        np.testing.assert_array_equal(file.camera.imu_to_camera, imu_to_camera("gyroflow"))
        about = " ".join(file.remarks)
        assert "submitted by a user" in about or changes
        assert ("readout time is unknown" in about) == (file.camera.readout_sd > 0)

    def test_a_global_shutter_has_no_readout(self, write: Write) -> None:
        assert open_camera(write(files.lens(frame_readout_time=None, global_shutter=True))).assumptions == ()

    def test_a_size_of_another_shape_is_scaled_by_its_width(self, write: Write) -> None:
        file = open_camera(write(files.lens()), size=(200, 100))
        camera = file.camera
        assert (camera.height, camera.focal_length, camera.principal_point) == (100, (105.0, 105.5), (99.5, 49.5))
        # 100 of the 150 lines that the whole picture would have.
        assert camera.readout_time == pytest.approx(0.01)
        assert "another aspect ratio" in file.assumptions[-1].text

    @pytest.mark.parametrize("size", [(400, 0), (-1, 300), (400, 2.5)])
    def test_impossible_sizes_are_refused(self, write: Write, size: Any) -> None:
        for path in (write(files.lens()), write(files.CAMERA_TOML[0], "camera.toml")):
            with pytest.raises(InputError, match="size must be"):
                open_camera(path, size=size)

    def test_settings_of_that_size_replace_those_of_the_profile(self, write: Write) -> None:
        path = write(files.LENSES[0])
        # the rate of the profile itself, if none is requested
        assert open_camera(path, size=(200, 150)).camera.readout_time == 0.008
        fast = open_camera(path, size=(200, 150), fps=59.94).camera
        assert (fast.readout_time, fast.focal_length[0]) == (0.004, 84.0)
        with pytest.raises(FileFormatError, match=r"frame rate: 90\.0, 99\.0"):
            open_camera(path, size=(100, 75))

    def test_a_polynomial_that_turns_back_in_the_corners_is_continued(self, write: Write) -> None:
        file = open_camera(write(files.LENSES[-1]))
        corners = np.array([[0.0, 0.0], [399.0, 299.0]])
        # The inverse of the polynomial is iterated to this.
        np.testing.assert_allclose(file.camera.project(file.camera.rays(corners)), corners, atol=1e-9)

    def test_a_project_adds_size_readout_and_clock(self, write: Write) -> None:
        file = open_camera(write(gyroflow.project({})))
        assert (file.camera.width, file.camera.readout_time, file.camera.readout_direction) == (200, 0.008, "top-down")
        assert file.camera.time_offset == pytest.approx(-0.0135)
        about = " ".join(assumption.text for assumption in file.assumptions)
        assert "drift by 2.0 ms" in about
        assert "turns the video by 90 degrees" in about


@pytest.fixture
def yaml() -> Any:
    return needs("kalibr")


@pytest.mark.usefixtures("yaml")
class TestKalibr:
    @pytest.mark.parametrize("form", files.KALIBR)
    def test_forms(self, write: Write, form: str) -> None:
        file = open_camera(write(files.KALIBR[form]))
        camera, lacks = file.camera, [assumption.about for assumption in file.assumptions]
        assert (camera.width, camera.height) == (400, 300)
        cx = 340.0 if "outside" in form else 190.0
        assert (camera.focal_length, camera.principal_point[0]) == ((210.0, 211.0), cx)
        # Some forms hold the inverse.
        np.testing.assert_allclose(camera.imu_to_camera, np.array(files.MATRIX)[:3, :3], atol=1e-15)
        assert camera.distortion == (-0.05, 0.001, 0.001, -0.002)
        assert camera.readout_time == pytest.approx(0.0 if form == "euroc" else 300 * 5e-5)
        # t_imu = t_cam + shift, and camera time = gyro time + offset
        assert camera.time_offset == (0.0 if form in ("euroc", "maplab", "advio") else -0.012)
        assert ("readout_time" in lacks) == (form == "euroc")
        assert any("swapped to 400x300" in each.text for each in file.assumptions) == ("swapped" in form)

    def test_one_of_several(self, write: Write) -> None:
        path = write(files.CHAIN + files.CHAIN.replace("cam0", "cam1").replace("210.0", "220.0"))
        assert open_camera(path, name="cam1").camera.focal_length[0] == 220.0
        assert "2 cameras (cam0, cam1); cam0 is used" in open_camera(path).assumptions[0].text
        with pytest.raises(FileFormatError, match=r"'cam7' .* cam0, cam1"):
            open_camera(path, name="cam7")


def test_dso(write: Write) -> None:
    fov, radtan = (open_camera(write(text)).camera for text in files.DSO)
    assert (fov.width, fov.height, fov.principal_point) == (1280, 1024, (0.49 * 1280 - 0.5, 511.5))
    theta = np.linspace(0.01, 1.2, 20)
    directions = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    radii = 0.35 * 1280 * np.arctan(2 * np.tan(theta) * np.tan(0.93 / 2)) / 0.93
    # px; the polynomial is fitted.
    np.testing.assert_allclose(fov.project(directions)[:, 0] - fov.principal_point[0], radii, atol=1e-3)
    assert (radtan.focal_length, radtan.distortion) == ((367.7, 369.8), (-0.3, 0.08, 0.002, -0.0006))


@pytest.mark.parametrize(
    ("fx", "fy", "lens", "words"),
    [
        (210, 230, "", "more than 5%"),
        (2100, 2100, "", "field of view of 10.9 degrees"),
        (210, 210, "50mm f/1.8", "a lens of 50 mm mean a sensor of 95.2 mm"),
        (210, 215, "18-55mm", None),
        # A stretched picture, and a long lens that is named.
        (210, 280, "", None),
        (2100, 2100, "90mm", None),
    ],
)
def test_implausible_profiles_are_remarked(write: Write, fx: float, fy: float, lens: str, words: str | None) -> None:
    matrix = {"camera_matrix": [[fx, 0, 200], [0, fy, 150], [0, 0, 1]], "distortion_coeffs": [0] * 4}
    profile = files.PROFILE | {"fisheye_params": matrix, "lens_model": lens, "compatible_settings": None}
    remarks = [each for each in open_camera(write(json.dumps(profile))).remarks if "readout" not in each]
    assert (len(remarks), (words or "") in "".join(remarks)) == (int(words is not None), True)


class TestExif:
    def test_film_equivalent(self, write: Write) -> None:
        path = write(files.photo((400, 300), f35=26), "a.jpg")
        with pytest.warns(RsdeblurWarning) as warned:
            camera = read_camera(path)
        assert camera.focal_length[0] == pytest.approx(26 / 43.267 * 500)
        assert len(warned) == 3  # focal length, readout, axes
        np.testing.assert_array_equal(camera.imu_to_camera, imu_to_camera("phone-landscape"))

    def test_focal_plane(self, write: Write) -> None:
        # 4000 px on 20 mm, reduced to a tenth, 400 px
        tags = {"focal_length": 50.0, "resolution": 4000 / 20 * 25.4, "unit": 2, "across": 4000}
        camera = open_camera(write(files.photo((400, 300), **tags), "a.jpg")).camera
        assert camera.focal_length[0] == pytest.approx(50 / 20 * 400, rel=1e-3)

    def test_portrait_and_zoom(self, write: Write) -> None:
        file = open_camera(write(files.photo((300, 400), f35=52, zoom=2.0), "a.jpg"))
        np.testing.assert_array_equal(file.camera.imu_to_camera, imu_to_camera("phone-portrait"))
        assert any("zoomed 2 times" in assumption.text for assumption in file.assumptions)


SAMPLES = {
    "gyroflow-lens-profile/Apple_iPhone 14 Pro_Main 24mm_24mm 24fps_4k_16by9_3840x2160-24.00fps.json": (
        "gyroflow-lens", (3840, 2160), 3155.09, 0.02, "fisheye"),
    "gyroflow-lens-profile/S25Ultra_23mm_3840x2160.json": ("gyroflow-lens", (3840, 2160), 2655.16, 0.0145, "fisheye"),
    "kalibr/euroc_mav_kalibr_imucam_chain.yaml": ("kalibr", (752, 480), 458.654, 0.0, "radtan"),
    "kalibr/fisheye-stereo.yaml": ("kalibr", (960, 800), 608.221, 0.0, "fisheye"),
    "kalibr/rs_camchain_line_delay.yaml": ("kalibr", (640, 480), 700.038, 480 * 3.3966922363735363e-05, "fisheye"),
    "exif/DSCN0010.jpg": ("exif", (640, 480), 112 / 43.267 * 800, 0.02, "none"),
    "exif/iphone_hdr_NO.jpg": ("exif", (3264, 2448), 57 / 43.267 * 4080, 0.02, "none"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "expected"), SAMPLES.items())
def test_samples(data_dir: Path, name: str, expected: tuple[Any, ...]) -> None:
    if name.startswith("kalibr"):
        needs("kalibr")
    file = open_camera(data_dir / "formats" / name)
    camera = file.camera
    assert (file.format, (camera.width, camera.height), camera.distortion_model) == (*expected[:2], expected[4])
    assert camera.focal_length[0] == pytest.approx(expected[2], abs=0.01)
    assert camera.readout_time == pytest.approx(expected[3])


class TestMars:
    def test_android(self, write: Write) -> None:
        path = write(files.CAPTURES["android"])
        with pytest.raises(FileFormatError, match="--size 1920x1080"):
            open_camera(path)
        file = open_camera(path, size=(1080, 1920), sensor_width=4000)
        assert file.camera.focal_length == (1440.0, 1440.0)
        assert (file.camera.readout_time, file.camera.readout_direction) == (0.03, "right-left")
        # Medians, without cells that are null.
        assert file.facts["exposure_s"] == 0.13
        # Without the sensor's width the focal length may be that of the whole sensor, which the field of view shows.
        assert any("--sensor-width" in each.text for each in open_camera(path, size=(1080, 1920)).assumptions)
        assert open_camera(path, size=(1920, 1080), focal_length=1500.0).camera.focal_length == (1500.0, 1500.0)

    def test_ios_contains_the_size(self, write: Write) -> None:
        file = open_camera(write(files.CAPTURES["ios"]))
        assert (file.camera.width, file.camera.height, file.camera.focal_length[0]) == (1920, 1080, 1500.5)
        assert file.camera.readout_sd > 0


def test_gcsv(write: Write) -> None:
    path = write(files.GYRO_TABLES["gcsv"][0])
    with pytest.raises(FileFormatError, match="--size"):
        open_camera(path)
    with pytest.raises(FileFormatError, match="--focal-length or --focal35"):
        open_camera(path, size=(1920, 1080))
    camera = open_camera(path, size=(1920, 1080), focal_length=1400).camera
    assert (camera.readout_time, camera.readout_direction, camera.timestamp_marks) == (0.0155, "bottom-up", "middle")


def test_gopro(data_dir: Path) -> None:
    needs("telemetry")
    needs("video")
    video = data_dir / "formats" / "gopro" / "max-heromode.mp4"
    camera = open_camera(video).camera
    assert (camera.width, camera.height, camera.distortion_model) == (848, 480, "fisheye")
    assert camera.readout_time == pytest.approx(0.0206, abs=1e-4)
    # The angle between the corner and the axis is half the diagonal field of view that the camera reports.
    x, y, z = camera.rays((camera.width - 0.5, camera.height - 0.5))
    assert math.degrees(math.atan2(math.hypot(x, y), z)) == pytest.approx(137.388 / 2, rel=1e-3)
    assert len(frame_exposures(video)) == 316


def test_exposures_of_insta360(tmp_path: Path) -> None:
    """The trailer is as telemetry-parser reads it; the first frame of the video is the third one measured."""
    needs("telemetry")
    first_frame = b"\xc0\x01\x43"  # field 24 of a Protobuf message: 67 (ms)
    gyro = b"".join(struct.pack("<Q6d", ms, *[0.0] * 6) for ms in range(20))
    exposures = b"".join(
        struct.pack("<Qd", ms, seconds) for ms, seconds in [(0, 0.5), (34, 0.5), (67, 0.01), (100, 0.02)]
    )
    records = b"".join(
        data + struct.pack("<2BI", 0, kind, len(data)) for kind, data in [(4, exposures), (3, gyro), (1, first_frame)]
    )
    end = bytes(32) + struct.pack("<2I", len(records) + 72, 3) + b"8db42d694ccc418790edff439fe026bf"
    video = tmp_path / "clip.mp4"
    video.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(99) + records + end)
    assert frame_exposures(video) == [0.01, 0.02]


REST = "# a camera\n  width = 64\nheight=48\nfocal_length = [\n  70.0, # fx\n  70.0,\n]\n{key}\nreadout_time = 0.01\n"


@pytest.mark.parametrize(
    "key", ["time_offset = 0.5 # mine", "'time_offset'=0.5", '"time\\u005foffset" = 0.5', "# none"]
)
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_the_offset_is_edited_in_place(write: Write, key: str, mark: str) -> None:
    """The file is read afterwards, and differs in one line only, new or edited."""
    before = REST.format(key=key)
    path = write(mark + before, "camera.toml")
    old = Camera.load(path)
    write_time_offset(path, -0.0125)
    assert repr(Camera.load(path)) == repr(replace(old, time_offset=-0.0125))
    lines, edited = before.splitlines(), path.read_text().splitlines()
    same = [line for line in edited if "0.0125" not in line]
    assert len(edited) - len(same) == 1
    assert same == [line for line in lines if "0.5" not in line]
    assert ("# mine" in path.read_text()) == ("# mine" in before)
