"""
Let the picture correct its recording
=====================================

A focal length that is wrong by a tenth, or a camera that also moves sideways, spoils the kernels.
:func:`rsdeblur.refine` finds such errors in the blurred picture, or refuses to correct anything.
"""

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(1.0, strength=0.8, seed=2)
camera = rsdeblur.Camera(384, 288, 360.0, readout_time=0.02)
exposure = rsdeblur.Exposure(start=0.4, duration=1 / 15)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(340, 450, seed=1), log, camera, exposure, noise=0.003)

# %%
# The camera file says a focal length that is 12 % too short:

wrong = rsdeblur.Camera(384, 288, 0.88 * 360.0, readout_time=0.02)
found = rsdeblur.refine(blurred, log, wrong, exposure)
print(f"accepted: {found.accepted}; focal length {found.camera.focal_length[0]:.0f} px")

pictures = {
    "blurred": blurred,
    "as recorded": rsdeblur.deblur(blurred, log, wrong, exposure).image,
    "corrected": rsdeblur.deblur(blurred, found.log, found.camera, found.exposure).image,
}
axes = rsdeblur.plot.comparison(pictures, reference=truth)
