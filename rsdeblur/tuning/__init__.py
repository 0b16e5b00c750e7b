"""What a blurred picture says of its noise, and the strengths of the regularisation that follow."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
