"""What a blurred picture says of its recording: corrections, the clock offset, and whether to trust a result."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
