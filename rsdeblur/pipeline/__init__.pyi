from .burst import BurstResult as BurstResult
from .burst import FrameUse as FrameUse
from .plan import DeblurResult as DeblurResult

__all__: list[str]
