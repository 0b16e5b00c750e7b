from .strength import Tuning as Tuning

__all__: list[str]
