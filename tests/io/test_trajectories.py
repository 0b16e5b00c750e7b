"""Poses of other programs: every layout gives the same trajectory, faults name the line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsdeblur import FileFormatError, read_trajectory

EPOCH, STEP = 1_403_636_579_763_555_584, 50_000_000
POSITIONS = np.array([(4.5, -1.5, 0.75), (4.625, -1.25, 0.5), (4.5, -1.0, 0.25)])
QUATERNIONS = np.array([(0.0, 0.0, 0.0, 1.0), (0.6, 0.0, 0.8, 0.0), (0.5, -0.5, 0.5, 0.5)])  # x, y, z, w


def rows(order: str, mark: str, *, seconds: bool = False, more: tuple[str, ...] = ()) -> str:
    lines = []
    for i, (position, quaternion) in enumerate(zip(POSITIONS, QUATERNIONS, strict=True)):
        timestamp = EPOCH + i * STEP
        values = dict(zip("xyz", position, strict=True)) | dict(zip("abcd", quaternion, strict=True))
        cells = [f"{timestamp // 10**9}.{timestamp % 10**9:09d}" if seconds else str(timestamp)]
        lines.append(mark.join([*cells, *(repr(float(values[name])) for name in order), *more]))
    return "\n".join(lines) + "\n"


EUROC = (
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x"
)
FILES = {
    "tum": "# timestamp tx ty tz qx qy qz qw\n" + rows("xyzabcd", " ", seconds=True),
    "tum without a header": rows("xyzabcd", " ", seconds=True),
    "tum in ns": rows("xyzabcd", " "),
    "euroc": EUROC + "\n" + rows("xyzdabc", ",", more=("0.5",)),
    "named": "time;px;py;pz;qw;qx;qy;qz\n" + rows("xyzdabc", ";"),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "poses.txt"


@pytest.mark.parametrize("text", FILES.values(), ids=FILES)
def test_layouts(path: Path, text: str) -> None:
    path.write_text(text)
    trajectory = read_trajectory(path)
    assert trajectory.epoch_ns == EPOCH
    np.testing.assert_array_equal(trajectory.t, np.arange(3) * STEP * 1e-9)
    np.testing.assert_array_equal(trajectory.position, POSITIONS)
    assert trajectory.quaternion is not None
    np.testing.assert_array_equal(trajectory.quaternion, QUATERNIONS)


@pytest.mark.parametrize("header", ["", "t[s],x[m],y[m],z[m]\n"])
def test_positions_alone(path: Path, header: str) -> None:
    path.write_text(header + rows("xyz", ",", seconds=True))
    trajectory = read_trajectory(path)
    np.testing.assert_array_equal(trajectory.position, POSITIONS)
    assert trajectory.quaternion is None


FAULTS = {
    "other columns": ("0.5 1 2 3 4\n1 1 2 3 4\n", "line 1: unknown trajectory format"),
    "zero quaternion": ("0 1 2 3 0 0 0 0\n1 1 2 3 0 0 0 1\n", "quaternion 0 has the norm 0 instead of 1"),
    "cell": ("0 1 2 3 0 0 0 1\n1 1 x 3 0 0 0 1\n2 1 2 3 0 0 0 1\n", "line 2: 'x' in column 3"),
    "repeated time": ("0 1 2 3\n1 1 2 3\n1 1 2 4\n2 1 2 3\n", "line 3: duplicate timestamp"),
    "one pose": ("0 1 2 3\n", "at least 2"),
    "empty": ("", "empty"),
    "header alone": ("timestamp tx ty tz qx qy qz qw\n", "no samples"),
}


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS)
def test_faults(path: Path, text: str, message: str) -> None:
    path.write_text(text)
    with pytest.raises(FileFormatError, match=rf"poses\.txt.*{message}"):
        read_trajectory(path)
