from .result import Calibration as Calibration
from .result import Estimate as Estimate

__all__: list[str]
