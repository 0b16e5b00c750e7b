"""Files: logs (`gyro_logs`), captures (`captures`), cameras (`cameras`) and pictures (`pictures`).

All are read in one way. `source` opens a file, whose lines and tables it reads with the place of what it cannot read,
and `formats` finds the format; `columns` finds the columns of tables; and one function per kind finishes what was
parsed, such as `samples.finish` for logs. The formats of logs are grouped by family: `gyro_tables` (text), `gyroflow`
and `gyro_binary` (pictures and videos). `trajectories` reads poses that other programs found; `picture_output` writes
pictures.
"""

from rsdeblur.io import cameras, captures, gyro_logs, trajectories
from rsdeblur.io.cameras import open_camera, read_camera
from rsdeblur.io.captures import read_captures
from rsdeblur.io.formats import KINDS, Format, is_archive
from rsdeblur.io.gyro_binary import is_video
from rsdeblur.io.gyro_logs import detect_gyro_format, open_gyro, read_acceleration, read_gyro
from rsdeblur.io.picture_output import write_picture
from rsdeblur.io.pictures import Picture, is_picture, read_depths, read_picture
from rsdeblur.io.samples import GYRO
from rsdeblur.io.trajectories import read_trajectory

__all__ = [
    "Picture",
    "open_camera",
    "open_gyro",
    "read_acceleration",
    "read_camera",
    "read_captures",
    "read_depths",
    "read_gyro",
    "read_picture",
    "read_trajectory",
    "write_picture",
]

# The first kind that fits is reported: a .gcsv log is a gyro log rather than a camera, MARS logger's metadata are
# captures rather than a camera. `detect_gyro_format` raises `FileFormatError`, which means no.
_video = Format("video", "video", lambda source: is_video(source) and not source.looks_like_text, open_gyro)
_zip = Format("zip", "zip archive", lambda each: is_archive(each) and bool(detect_gyro_format(each.path)), open_gyro)
KINDS |= {
    "picture": ("give it as the photo", [Format("picture", "picture", is_picture, read_picture)]),
    "video": ("give it to rsdeblur video", [_video]),
    "gyro log": ("give it as --gyro", [*(each for each in gyro_logs.FORMATS[GYRO] if each.name != "video"), _zip]),
    "capture file": ("give it as --capture", captures.FORMATS),
    "camera file": ("give it as --camera", cameras.FORMATS),
    "trajectory": ("rsdeblur.read_trajectory reads it", trajectories.FORMATS),
}
