from .acceleration import AccelerationLog as AccelerationLog
from .paths import BlurPaths as BlurPaths
from .paths import Capture as Capture
from .trajectory import Trajectory as Trajectory
from .triage import Triage as Triage

__all__: list[str]
