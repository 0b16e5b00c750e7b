"""Files: gyro logs (`gyro_logs`), captures (`captures`), cameras (`cameras`) and pictures (`pictures`).

`source` opens a file and finds its format, and `text` reads numbers and names a line that cannot be read. The readers
of gyro logs are grouped by family: `gyro_tables` (text), `gyroflow`, `gyro_binary` (pictures and videos) and
`archives`; `columns` finds the columns of tables, and `samples` makes a log from what they return. `accelerations`
reads accelerometers from the same files, `trajectories` reads poses that other programs found, and `arrays` PSFs and
maps of depths. `picture_output` writes pictures. `kinds` names the kind of a file that is given in place of another
one.
"""

from rsdeblur.io.accelerations import read_acceleration
from rsdeblur.io.arrays import read_depths
from rsdeblur.io.cameras import open_camera, read_camera
from rsdeblur.io.captures import read_captures
from rsdeblur.io.clocks import Clocks, read_clocks
from rsdeblur.io.gyro_logs import detect_gyro_format, open_gyro, read_gyro
from rsdeblur.io.picture_output import check_writable, write_picture
from rsdeblur.io.pictures import Picture, read_picture
from rsdeblur.io.trajectories import read_trajectory

__all__ = [
    "Clocks",
    "Picture",
    "check_writable",
    "detect_gyro_format",
    "open_camera",
    "open_gyro",
    "read_acceleration",
    "read_camera",
    "read_captures",
    "read_clocks",
    "read_depths",
    "read_gyro",
    "read_picture",
    "read_trajectory",
    "write_picture",
]
