from .burst import BurstResult as BurstResult
from .burst import FrameUse as FrameUse

__all__: list[str]
