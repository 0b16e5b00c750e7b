from .check import QualityCheck as QualityCheck
from .refine import Refinement as Refinement
from .strength import Tuning as Tuning
from .time_offset import OffsetSearch as OffsetSearch
from .time_offset import SharedOffset as SharedOffset
from .time_offset import find_shared_time_offset as find_shared_time_offset
from .triage import Triage as Triage

__all__: list[str]
