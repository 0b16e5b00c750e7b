"""
Frames of a video
=================

A plan decides strengths and tiles once; ``replan`` takes the motion of the next frame and keeps all else, with its
transforms.
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
    capture = rsdeblur.Capture.from_log(log, camera, exposure)
    lengths = rsdeblur.BlurPaths.from_capture(capture, rows=[0, 83.5, 167], cols=[111.5]).lengths
    print(f"frame {i}: {np.max(lengths):4.1f} px")

# %%

options = rsdeblur.Options(prior="wiener", check=False)
plan = rsdeblur.plan(log, camera, exposures[0], options).prepare(frames[0])
sharp = [plan.replan(log, exposure).apply(frame) for exposure, frame in zip(exposures, frames, strict=True)]
axes = rsdeblur.plot.comparison({f"frame {i}": frames[i] for i in (0, 2, 4)})
axes = rsdeblur.plot.comparison({f"frame {i}, deblurred": sharp[i] for i in (0, 2, 4)})
