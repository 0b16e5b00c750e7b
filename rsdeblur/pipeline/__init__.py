"""From a photo and its motion to the sharp picture: :func:`rsdeblur.deblur` and :func:`rsdeblur.plan`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
