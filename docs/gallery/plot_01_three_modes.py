"""
Simulate a capture and score three modes
========================================

The simulator warps a sharp scene along the camera's motion. It returns the blurred picture and the truth, so every
result has a PSNR.
"""

import rsdeblur
import rsdeblur.plot

# %%
# A shaking hand, a camera that reads its rows in 30 ms, and an exposure of 1/20 s:

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=1)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(200, 270), log, camera, exposure, noise=0.005)

# %%
# One kernel for the picture, one for each tile, one for each row:

pictures = {"blurred": blurred}
for mode in ("global", "banded", "rowwise"):
    pictures[mode] = rsdeblur.deblur(blurred, log, camera, exposure, mode=mode, prior="hyper-laplacian")
axes = rsdeblur.plot.comparison(pictures, reference=truth, crop=(40, 40, 84, 112))

# %%
# ``check`` judges a result without the truth. A log that is 40 ms late gives a clear verdict:

for name, shift in (("right clock", 0.0), ("40 ms late", 0.04)):
    check = rsdeblur.deblur(blurred, log.shifted(shift), camera, exposure).check
    print(f"{name}: {check.verdict}", *check.reasons, sep="\n  ")
