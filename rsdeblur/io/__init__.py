"""Files: gyro logs (`gyro_logs`), captures (`captures`), cameras (`cameras`) and pictures (`pictures`).

Gyro logs and captures are text; `formats` is their registry and `text` reads their numbers and names the line that
cannot be read.
"""

from rsdeblur.io.cameras import read_camera
from rsdeblur.io.captures import read_captures
from rsdeblur.io.gyro_logs import detect_gyro_format, read_gyro
from rsdeblur.io.pictures import Picture, check_writable, read_picture, write_picture

__all__ = [
    "Picture",
    "check_writable",
    "detect_gyro_format",
    "read_camera",
    "read_captures",
    "read_gyro",
    "read_picture",
    "write_picture",
]
