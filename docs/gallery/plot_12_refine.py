"""
Let the picture correct its recording
=====================================

A gyroscope does not measure that the hand also moves sideways. :func:`rsdeblur.refine` finds such a drift in the
blurred picture, and errors of the clock and the focal length, or refuses to correct anything.
"""

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(1.2, seed=5)
camera = rsdeblur.Camera(288, 216, 420.0, readout_time=0.02)
exposure = rsdeblur.Exposure(start=0.5, duration=1 / 20)
drift = rsdeblur.Translation.drift((3.0, -2.0), camera, exposure)
scene = rsdeblur.scene(248, 320)
blurred, _, truth = rsdeblur.simulate(scene, log, camera, exposure, translation=drift, noise=0.005)

# %%
# Only the drift is unknown here, which makes the search short:

found = rsdeblur.refine(blurred, log, camera, exposure, free="drift")
print(f"{found.values.drift_x:.1f} and {found.values.drift_y:.1f} px")

pictures = {
    "blurred": blurred,
    "gyro alone": rsdeblur.deblur(blurred, log, camera, exposure),
    "corrected": rsdeblur.deblur(blurred, log, camera, exposure, translation=found.translation),
}
axes = rsdeblur.plot.comparison(pictures, reference=truth)
