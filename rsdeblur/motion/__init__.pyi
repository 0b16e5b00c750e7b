from .alignment import rectify as rectify
from .gyro import AccelerationLog as AccelerationLog
from .paths import BlurPaths as BlurPaths
from .paths import Capture as Capture
from .translation import Trajectory as Trajectory
from .triage import Triage as Triage

__all__: list[str]
