"""Camera files of other programs: numbers, axes, clocks and lens as each defines them, or a refusal with its reason."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rsdeblur import Camera, FileFormatError, InputError, RsdeblurWarning, read_camera
from rsdeblur.io import open_camera
from rsdeblur.io.cameras import write_time_offset
from rsdeblur.motion.axes import PRESETS, imu_to_camera, orientation
from tests.installed import needs

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(content: str | dict[str, Any], name: str = "camera.yaml") -> Path:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return path

    return write


class TestAxes:
    def test_a_phone_held_upright(self) -> None:
        # The rows of the table in docs/camera-file.md, fitted on real recordings.
        np.testing.assert_array_equal(imu_to_camera("phone-portrait"), np.diag([1, -1, -1]))
        np.testing.assert_array_equal(imu_to_camera("phone-landscape"), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]])
        np.testing.assert_array_equal(imu_to_camera("gyroflow"), [[0, -1, 0], [-1, 0, 0], [0, 0, -1]])

    def test_letters_are_output_axes_of_raw_axes(self) -> None:
        raw = np.array([1.0, 2.0, 3.0])
        np.testing.assert_array_equal(orientation("YxZ") @ raw, [2, -1, 3])
        np.testing.assert_array_equal(orientation("xzY") @ raw, [-1, -3, 2])

    def test_a_camera_file_may_use_them(self, write: Write) -> None:
        camera = read_camera(write('width = 4\nheight = 3\nfocal_length = 5\nimu_to_camera = "YxZ"\n', "camera.toml"))
        np.testing.assert_array_equal(camera.imu_to_camera, imu_to_camera("phone-portrait"))

    @pytest.mark.parametrize("name", PRESETS)
    def test_presets_are_rotations_by_quarter_turns(self, name: str) -> None:
        assert np.linalg.det(imu_to_camera(name)) == pytest.approx(1)
        assert Camera(4, 3, 5.0, imu_to_camera=name).imu_to_camera.shape == (3, 3)

    def test_the_four_ways_to_hold_a_phone_are_turns_of_the_picture(self) -> None:
        camera = Camera(4, 3, 5.0, imu_to_camera="phone-landscape")
        for name in ("phone-portrait", "phone-landscape-reversed", "phone-portrait-reversed", "phone-landscape"):
            camera = camera.turned()
            np.testing.assert_allclose(camera.imu_to_camera, imu_to_camera(name), atol=1e-15)

    @pytest.mark.parametrize("name", ["XYX", "AYZ", "phone"])
    def test_others_are_refused(self, name: str) -> None:
        with pytest.raises(InputError, match=r"no IMU orientation|orientation must name"):
            Camera(4, 3, 5.0, imu_to_camera=name)


def profile(**changes: Any) -> dict[str, Any]:
    return {
        "calib_dimension": {"w": 400, "h": 300},
        "fisheye_params": {
            "camera_matrix": [[210.0, 0.0, 190.0], [0.0, 211.0, 160.0], [0.0, 0.0, 1.0]],
            "distortion_coeffs": [0.05, -0.02, 0.01, -0.003],
        },
        "asymmetrical": False,
        "frame_readout_time": 15.0,
        "fps": 30.0,
        "crop": None,
        "distortion_model": None,
    } | changes


class TestLensProfile:
    def test_as_it_is(self, write: Write) -> None:
        file = open_camera(write(profile()))
        camera = file.camera
        assert (camera.width, camera.height, camera.focal_length) == (400, 300, (210.0, 211.0))
        assert (camera.distortion_model, camera.distortion) == ("fisheye", (0.05, -0.02, 0.01, -0.003))
        assert (camera.readout_time, camera.readout_direction, camera.timestamp_marks) == (0.015, "top-down", "middle")
        np.testing.assert_array_equal(camera.imu_to_camera, imu_to_camera("gyroflow"))
        assert any("submitted by a user" in assumption.text for assumption in file.assumptions)

    def test_centre_model_and_crop(self, write: Write) -> None:
        assert open_camera(write(profile())).camera.principal_point == (199.5, 149.5)
        assert open_camera(write(profile(asymmetrical=True))).camera.principal_point == (190.0, 160.0)
        camera = open_camera(write(profile(distortion_model="opencv_standard"))).camera
        assert (camera.distortion_model, camera.distortion) == ("radtan", (0.05, -0.02, 0.01, -0.003))
        assert open_camera(write(profile(crop=1.25))).camera.focal_length == (168.0, 168.8)

    @pytest.mark.parametrize(
        ("time", "word", "readout_time", "direction"),
        [
            (-15.0, None, 0.015, "bottom-up"),
            (15.0, "BottomToTop", 0.015, "bottom-up"),
            (15.0, "LeftToRight", 0.015, "left-right"),
            (-15.0, "RightToLeft", 0.015, "right-left"),
            (None, None, 0.0, "top-down"),
        ],
    )
    def test_readout(
        self, write: Write, time: float | None, word: str | None, readout_time: float, direction: str
    ) -> None:
        file = open_camera(write(profile(frame_readout_time=time, frame_readout_direction=word)))
        assert (file.camera.readout_time, file.camera.readout_direction) == (readout_time, direction)
        assert any("does not contain the readout" in assumption.text for assumption in file.assumptions) == (
            time is None
        )

    def test_an_implausible_readout_is_an_assumption(self, write: Write) -> None:
        assert "implausible" in open_camera(write(profile(frame_readout_time=0.41))).assumptions[0].text
        assert open_camera(write(profile(frame_readout_time=None, global_shutter=True))).assumptions == ()

    def test_a_size_of_another_shape_is_scaled_by_its_width(self, write: Write) -> None:
        file = open_camera(write(profile()), size=(200, 100))
        camera = file.camera
        assert (camera.height, camera.focal_length, camera.principal_point) == (100, (105.0, 105.5), (99.5, 49.5))
        # 100 of the 150 lines that the whole picture would have.
        assert camera.readout_time == pytest.approx(0.01)
        assert "another aspect ratio" in file.assumptions[-1].text
        # The field of view along the width is that of the file.
        assert camera.width / camera.focal_length[0] == 400 / 210

    @pytest.mark.parametrize("size", [(400, 0), (-1, 300), (400, 2.5)])
    def test_impossible_sizes_are_refused(self, write: Write, size: Any) -> None:
        for path in (write(profile()), write("width = 4\nheight = 3\nfocal_length = 5\n", "camera.toml")):
            with pytest.raises(InputError, match="size must be"):
                open_camera(path, size=size)

    def test_settings_of_that_size_replace_those_of_the_profile(self, write: Write) -> None:
        settings = [
            {"width": 200, "height": 150, "fps": 30.0, "frame_readout_time": 8.0},
            {"width": 200, "height": 150, "fps": 60.0, "frame_readout_time": 4.0, "crop": 1.25},
            {"width": 100, "height": 75, "fps": 90.0, "frame_readout_time": 3.0},
            {"width": 100, "height": 75, "fps": 99.0, "frame_readout_time": 2.0},
        ]
        path = write(profile(compatible_settings=settings))
        # the rate of the profile itself, if none is requested
        assert open_camera(path, size=(200, 150)).camera.readout_time == 0.008
        fast = open_camera(path, size=(200, 150), fps=59.94).camera
        assert (fast.readout_time, fast.focal_length[0]) == (0.004, 84.0)
        with pytest.raises(FileFormatError, match=r"frame rate: 90\.0, 99\.0"):
            open_camera(path, size=(100, 75))

    def test_a_polynomial_that_turns_back_in_the_corners_is_continued(self, write: Write) -> None:
        # It turns back at 1.075 focal lengths; the picture's sides are at 0.95, its corners at 1.18.
        k = [0.2637886549359052, -0.3408966786255753, 1.079728890594674, -0.9412173670690532]
        file = open_camera(write(profile(fisheye_params=profile()["fisheye_params"] | {"distortion_coeffs": k})))
        assert "does not reach the picture's corners" in file.assumptions[-1].text
        corners = np.array([[0.0, 0.0], [399.0, 299.0]])
        np.testing.assert_allclose(file.camera.project(file.camera.rays(corners)), corners, atol=1e-9)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"calib_dimension": {"w": 0, "h": 0}}, "no calibration"),
            ({"fisheye_params": {"camera_matrix": [[1, 2], [3, 4]]}}, "no calibration"),
            ({"distortion_model": "poly3"}, "poly3"),
            ({"digital_lens": "gopro_superview"}, "gopro_superview"),
            ({"input_horizontal_stretch": 1.33}, "stretches"),
            ({"crop": "half"}, "damaged"),
        ],
    )
    def test_faults(self, write: Write, changes: dict[str, Any], message: str) -> None:
        with pytest.raises(FileFormatError, match=rf"camera\.yaml: .*{message}"):
            open_camera(write(profile(**changes)))

    def test_a_project_adds_size_readout_and_clock(self, write: Write) -> None:
        project = {
            "title": "Gyroflow data file",
            "calibration_data": profile(frame_readout_time=None),
            "video_info": {"width": 200, "height": 150, "fps": 30.0},
            "stabilization": {"frame_readout_time": 12.0, "frame_readout_direction": "TopToBottom"},
            "offsets": {"1000000": -20.0, "9000000": -30.0},
        }
        file = open_camera(write(project))
        assert (file.camera.width, file.camera.readout_time) == (200, 0.012)
        assert file.camera.time_offset == pytest.approx(-0.025)
        assert any("drift by 10.0 ms" in assumption.text for assumption in file.assumptions)
        with pytest.raises(FileFormatError, match="contains no calibration"):
            open_camera(write(project | {"calibration_data": {}}))


MATRIX = [[0.0, -1.0, 0.0, 0.1], [-1.0, 0.0, 0.0, 0.2], [0.0, 0.0, -1.0, 0.3], [0.0, 0.0, 0.0, 1.0]]
CHAIN = f"""cam0:
  T_cam_imu: {MATRIX}
  camera_model: pinhole
  distortion_coeffs: [-0.05, 1e-3, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [210.0, 211.0, 190.0, 140.0]
  resolution: [400, 300]
  timeshift_cam_imu: 0.012
  line_delay: 5e-05
"""


@pytest.fixture
def yaml() -> Any:
    return needs("kalibr")


@pytest.mark.usefixtures("yaml")
class TestKalibr:
    def check(self, path: Path) -> None:
        camera = open_camera(path).camera
        assert (camera.width, camera.height) == (400, 300)
        assert (camera.focal_length, camera.principal_point) == ((210.0, 211.0), (190.0, 140.0))
        np.testing.assert_array_equal(camera.imu_to_camera, np.array(MATRIX)[:3, :3])
        assert camera.readout_time == pytest.approx(300 * 5e-5)
        assert camera.distortion == (-0.05, 0.001, 0.001, -0.002)
        # t_imu = t_cam + shift, and camera time = gyro time + offset
        assert camera.time_offset == -0.012

    @pytest.mark.parametrize(
        "text",
        [
            CHAIN,
            "%YAML:1.0\n---\n" + CHAIN,
            "%YAML:1.0 # a remark\n\n" + CHAIN,
            CHAIN.replace(str(MATRIX), str(np.ravel(MATRIX).tolist())),
            CHAIN.replace(f"T_cam_imu: {MATRIX}", f"T_imu_cam: {np.linalg.inv(MATRIX).tolist()}"),
            CHAIN.replace(str(MATRIX), f"!!opencv-matrix {{rows: 4, cols: 4, data: {np.ravel(MATRIX).tolist()}}}"),
        ],
        ids=["plain", "opencv header", "header with a remark", "flat", "inverse", "opencv matrix"],
    )
    def test_variants(self, write: Write, text: str) -> None:
        self.check(write(text))

    @pytest.mark.parametrize("point", ["340.0, 140.0", "190.0, 145.0"], ids=["outside", "off the middle"])
    def test_a_swapped_resolution_is_found_by_the_principal_point(self, write: Write, point: str) -> None:
        text = CHAIN.replace("[400, 300]", "[300, 400]").replace("190.0, 140.0", point)
        file = open_camera(write(text))
        assert (file.camera.width, file.camera.height) == (400, 300)
        assert "swapped to 400x300" in file.assumptions[0].text

    def test_maplab(self, write: Write) -> None:
        text = f"""label: rig
cameras:
- T_B_C: {{cols: 4, rows: 4, data: {np.linalg.inv(MATRIX).tolist()}}}
  camera:
    line-delay-nanoseconds: 50000
    image_width: 400
    image_height: 300
    type: pinhole
    intrinsics: {{cols: 1, rows: 4, data: [210.0, 211.0, 190.0, 140.0]}}
    distortion: {{type: radial-tangential, parameters: {{cols: 1, rows: 4, data: [-0.05, 0.001, 0.001, -0.002]}}}}
  timeshift_cam_imu: 0.012
"""
        camera = open_camera(write(text)).camera
        np.testing.assert_allclose(camera.imu_to_camera, np.array(MATRIX)[:3, :3], atol=1e-15)
        assert camera.readout_time == pytest.approx(0.015)
        assert camera.distortion == (-0.05, 0.001, 0.001, -0.002)

    def test_euroc_sensor_file(self, write: Write) -> None:
        text = f"""sensor_type: camera
T_BS: {{cols: 4, rows: 4, data: {np.ravel(np.linalg.inv(MATRIX)).tolist()}}}
resolution: [400, 300]
camera_model: pinhole
intrinsics: [210.0, 211.0, 190.0, 140.0]
distortion_model: radial-tangential
distortion_coefficients: [-0.05, 0.001, 0.001, -0.002]
"""
        file = open_camera(write(text))
        np.testing.assert_allclose(file.camera.imu_to_camera, np.array(MATRIX)[:3, :3], atol=1e-15)
        assert "global shutter" in file.assumptions[0].text

    def test_one_of_several(self, write: Write) -> None:
        path = write(CHAIN + CHAIN.replace("cam0", "cam1").replace("210.0", "220.0"))
        assert open_camera(path, name="cam1").camera.focal_length[0] == 220.0
        assert "2 cameras (cam0, cam1); cam0 is used" in open_camera(path).assumptions[0].text
        with pytest.raises(FileFormatError, match=r"'cam7' .* cam0, cam1"):
            open_camera(path, name="cam7")

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (("pinhole", "omni"), "camera model 'omni'"),
            (("radtan", "fov"), "distortion model 'fov'"),
            (("[400, 300]", "[400]"), "cam0: damaged or incomplete"),
            (("intrinsics", "intrinsic"), "cam0: damaged or incomplete"),
            (("[210.0", "[-210.0"), "cam0: focal_length must be positive"),
            (("[-1.0, 0.0, 0.0, 0.2]", "[1.0, 0.0, 0.0, 0.2]"), "determinant -1"),
            (("cam0:", "cam0: ["), "not YAML"),
        ],
    )
    def test_faults(self, write: Write, change: tuple[str, str], message: str) -> None:
        with pytest.raises(FileFormatError, match=rf"camera\.yaml: .*{message}"):
            open_camera(write(CHAIN.replace(*change)))

    def test_without_pyyaml(self, write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "yaml", None)
        with pytest.raises(FileFormatError, match=r"need PyYAML.*'\.\[kalibr\]'"):
            open_camera(write(CHAIN))


def photo(path: Path, size: tuple[int, int] = (400, 300), **tags: Any) -> Path:
    numbers = {
        "f35": 0xA405,
        "focal_length": 0x920A,
        "resolution": 0xA20E,
        "unit": 0xA210,
        "across": 0xA002,
        "zoom": 0xA404,
    }
    exif = Image.Exif()
    block = exif.get_ifd(0x8769)
    for name, value in tags.items():
        block[numbers[name]] = value
    Image.new("RGB", size).save(path, exif=exif)
    return path


class TestExif:
    def test_film_equivalent(self, tmp_path: Path) -> None:
        path = photo(tmp_path / "a.jpg", f35=26)
        with pytest.warns(RsdeblurWarning) as warned:
            camera = read_camera(path)
        assert camera.focal_length[0] == pytest.approx(26 / 43.267 * 500)
        assert len(warned) == 3  # focal length, readout, axes
        np.testing.assert_array_equal(camera.imu_to_camera, imu_to_camera("phone-landscape"))

    def test_focal_plane(self, tmp_path: Path) -> None:
        # 4000 px on 20 mm, reduced to a tenth, 400 px
        path = photo(tmp_path / "a.jpg", focal_length=50.0, resolution=4000 / 20 * 25.4, unit=2, across=4000)
        assert open_camera(path).camera.focal_length[0] == pytest.approx(50 / 20 * 400, rel=1e-3)

    def test_portrait_and_zoom(self, tmp_path: Path) -> None:
        file = open_camera(photo(tmp_path / "a.jpg", (300, 400), f35=52, zoom=2.0))
        np.testing.assert_array_equal(file.camera.imu_to_camera, imu_to_camera("phone-portrait"))
        assert "zoomed 2 times" in file.assumptions[-1].text

    @pytest.mark.parametrize(
        ("tags", "message"),
        [
            ({}, "no focal length in px"),
            ({"f35": 0, "focal_length": 4.2}, "only 4.2 mm"),
            ({"focal_length": 135.0, "resolution": 4438.0, "unit": 2}, "was resized"),
        ],
    )
    def test_refusals(self, tmp_path: Path, tags: dict[str, Any], message: str) -> None:
        with pytest.raises(FileFormatError, match=rf"a\.jpg: .*{message}.*rsdeblur camera new"):
            open_camera(photo(tmp_path / "a.jpg", (100, 68), **tags))


SAMPLES = {
    "gyroflow-lens-profile/Apple_iPhone 14 Pro_Main 24mm_24mm 24fps_4k_16by9_3840x2160-24.00fps.json": (
        "gyroflow-lens", (3840, 2160), 3155.09, 0.0, "fisheye"),
    "gyroflow-lens-profile/S25Ultra_23mm_3840x2160.json": ("gyroflow-lens", (3840, 2160), 2655.16, 0.0145, "fisheye"),
    "kalibr/euroc_mav_kalibr_imucam_chain.yaml": ("kalibr", (752, 480), 458.654, 0.0, "radtan"),
    "kalibr/fisheye-stereo.yaml": ("kalibr", (960, 800), 608.221, 0.0, "fisheye"),
    "kalibr/rs_camchain_line_delay.yaml": ("kalibr", (640, 480), 700.038, 480 * 3.3966922363735363e-05, "fisheye"),
    "exif/DSCN0010.jpg": ("exif", (640, 480), 112 / 43.267 * 800, 0.0, "none"),
    "exif/iphone_hdr_NO.jpg": ("exif", (3264, 2448), 57 / 43.267 * 4080, 0.0, "none"),
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


KEYS = (
    "time_offset = 0.5 # mine",
    '"time_offset" = 0.5',
    "'time_offset'=0.5",
    '"time\\u005foffset" = 0.5',
    "",
    "# none",
)
REST = "# a camera\n  width = 64\nheight=48\nfocal_length = [\n  70.0, # fx\n  70.0,\n]\n{key}\nreadout_time = 0.01"


@pytest.mark.parametrize("end", ["", "\n", "\n\n\n"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("key", KEYS)
def test_the_offset_is_edited_in_place(tmp_path: Path, key: str, mark: str, line_end: str, end: str) -> None:
    """The file is read afterwards, and differs in one line only, new or edited."""
    path = tmp_path / "camera.toml"
    before = (mark + REST.format(key=key) + end).replace("\n", line_end)
    path.write_bytes(before.encode())
    old = Camera.load(path)
    write_time_offset(path, -0.0125)
    assert repr(Camera.load(path)) == repr(replace(old, time_offset=-0.0125))
    after = path.read_bytes().decode()
    assert after.startswith(mark)
    assert after.count("\n") == after.count(line_end)
    lines, edited = before.splitlines(), after.splitlines()
    same = [line for line in edited if "0.0125" not in line]
    assert len(edited) - len(same) == 1
    assert same == [line for line in lines if "0.5" not in line]
    assert ("# mine" in after) == ("# mine" in before)
