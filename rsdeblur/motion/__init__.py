"""From gyro log to blur paths: where the light of each pixel comes from while its row is exposed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
