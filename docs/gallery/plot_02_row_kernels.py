"""
The kernels of a rolling shutter
================================

Each row is exposed in its own window, so the blur changes down the picture.
"""

import matplotlib.pyplot as plt
import numpy as np

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=1)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)

# %%
# The gyroscope's rates. All rows are exposed in the dark part of the window, some in the light parts:

axes = rsdeblur.plot.log(log, camera, exposure)

# %%
# The paths of pixels during their row's window, and the kernels that follow from them:

capture = rsdeblur.motion.Capture.from_log(log, camera, exposure)
paths = rsdeblur.motion.BlurPaths.from_capture(capture, rows=np.linspace(16, 150, 5), cols=np.linspace(28, 196, 4))
_, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
rsdeblur.plot.paths(paths, ax=left)
bank = rsdeblur.psfs(log, camera, exposure)
right.imshow(rsdeblur.report.psf_map(bank, (camera.height, camera.width)))
right.set_axis_off()

# %%
# ``bank.at`` interpolates the kernel at any point:

_, axes = plt.subplots(1, 4, figsize=(9, 2), layout="constrained")
for ax, row in zip(axes, (0, 56, 112, 167), strict=True):
    ax.imshow(np.sqrt(bank.at(row, 112)), cmap="magma")
    ax.set_title(f"row {row}")
