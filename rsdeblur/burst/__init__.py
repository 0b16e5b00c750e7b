"""Several frames of one scene, shaken differently, deblurred together: :func:`rsdeblur.deblur_burst`.

`frames` resamples, compares and weighs them, `alignment` chooses the reference, and `solution` solves them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
