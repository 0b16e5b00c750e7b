"""Simulated photos: a forward model that shares no code with the blur paths and PSFs, a test scene and hand shake."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
