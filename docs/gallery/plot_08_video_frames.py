"""
Frames of a video
=================

The strengths of the first frame serve all frames, so that brightness and noise do not flicker; each frame has its own
motion.
"""

import numpy as np

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(1.0, strength=0.6, seed=5)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.02)
exposures = [rsdeblur.Exposure(0.2 + i / 30, 1 / 40) for i in range(6)]
frames = list(rsdeblur.simulate_clip(rsdeblur.scene(210, 290), log, camera, exposures, noise=0.005))

# %%
# The lengths of the paths say which frames are worth the work:

for i, exposure in enumerate(exposures):
    capture = rsdeblur.motion.Capture.from_log(log, camera, exposure)
    lengths = rsdeblur.motion.BlurPaths.from_capture(capture, rows=[0, 83.5, 167], cols=[111.5]).lengths
    print(f"frame {i}: {np.max(lengths):4.1f} px")

# %%

first = rsdeblur.deblur(frames[0], log, camera, exposures[0], prior="wiener", check=False)
sharp = [first.image]
for exposure, frame in zip(exposures[1:], frames[1:], strict=True):
    sharp.append(rsdeblur.deblur(frame, log, camera, exposure, prior="wiener", nsr=first.nsr, check=False).image)
axes = rsdeblur.plot.comparison({f"frame {i}": frames[i] for i in (0, 2, 4)})
axes = rsdeblur.plot.comparison({f"frame {i}, deblurred": sharp[i] for i in (0, 2, 4)})
