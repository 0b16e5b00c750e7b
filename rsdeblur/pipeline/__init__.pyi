from .plan import DeblurResult as DeblurResult

__all__: list[str]
