"""Deconvolution: transforms, tiles, Wiener filters, priors and the rowwise solve. No module here knows a gyro."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
