from .calibrate import Calibration as Calibration
from .calibrate import Estimate as Estimate
from .calibrate_photos import PhotoCalibration as PhotoCalibration
from .check import QualityCheck as QualityCheck
from .refine import Refinement as Refinement
from .strength import Tuning as Tuning
from .time_offset import OffsetSearch as OffsetSearch

__all__: list[str]
