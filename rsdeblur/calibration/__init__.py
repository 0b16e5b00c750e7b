"""Calibration of camera, clock and gyro: from clips, from blurred photos, and from the bands of a lamp."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
