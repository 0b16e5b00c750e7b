"""
Priors
======

A prior is an assumption about sharp pictures. ``"wiener"`` has none beyond the spectrum, and ``"gradient"``, ``"tv"``
and ``"hyper-laplacian"`` prefer small gradients ever more sparsely. Automatic strengths are used for all.
"""

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=3)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.02)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 25)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(200, 270), log, camera, exposure, noise=0.01)

pictures = {"blurred": blurred}
for prior in ("wiener", "gradient", "tv", "hyper-laplacian"):
    pictures[prior] = rsdeblur.deblur(blurred, log, camera, exposure, prior=prior, check=False)
axes = rsdeblur.plot.comparison(pictures, reference=truth, crop=(40, 30, 60, 80))
