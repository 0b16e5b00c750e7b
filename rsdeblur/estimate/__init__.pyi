from .check import QualityCheck as QualityCheck
from .refine import Refinement as Refinement
from .time_offset import OffsetSearch as OffsetSearch

__all__: list[str]
