"""
A burst
=======

Every shaken frame has lost other details. :func:`rsdeblur.deblur_burst` solves several frames of one scene together, in
the pose of the one that promises the least error.
"""

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(1.0, strength=0.8, seed=8)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.02)
exposures = [rsdeblur.Exposure(start, 1 / 15) for start in (0.2, 0.4, 0.6)]
scene = rsdeblur.scene(230, 310, seed=1)
frames = list(rsdeblur.simulate_clip(scene, log, camera, exposures, noise=0.02))

burst = rsdeblur.deblur_burst(frames, log, camera, exposures)
for frame in burst.frames:
    print(f"share {frame.share:.2f}, radius of the blur {frame.blur:.1f} px, shift {frame.shift:.2f} px")

# %%
# The truth is what an exposure of 10 µs, without noise, shows in the pose of the reference:

moments = [rsdeblur.Exposure(exposure.start + exposure.duration / 2, 1e-5) for exposure in exposures]
truth = list(rsdeblur.simulate_clip(scene, log, camera, moments))[burst.reference]
reference = frames[burst.reference], exposures[burst.reference]
pictures = {
    "reference": reference[0],
    "deblurred alone": rsdeblur.deblur(reference[0], log, camera, reference[1]),
    "together": burst,
}
axes = rsdeblur.plot.comparison(pictures, reference=truth)
