"""
Plug in a denoiser
==================

:class:`rsdeblur.RowBlur` is the row-exact blur as a linear operator with an adjoint, so any algorithm for linear
inverse problems can use it. Here: proximal gradient steps whose proximal step is a denoiser of scikit-image.
"""

import numpy as np
from skimage.restoration import denoise_tv_chambolle

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=1)
camera = rsdeblur.Camera(160, 120, 150.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(150, 200), log, camera, exposure, noise=0.01)

# %%
# The operator of all rows. The latent picture has rows beyond the frame, which no row of the frame shows alone:

capture = rsdeblur.Capture.from_log(log, camera, exposure)
blur = rsdeblur.RowBlur(rsdeblur.BlurPaths.every_row(capture, cols=[40, 120]), width=160, channels=3)
print(blur)

# %%
# A step along the gradient of the squared residual, then the denoiser. The blur's largest singular value is about 1,
# so steps of 1 are stable:

top, latents = -blur.top, blur.latent_shape[0]
latent = np.pad(blurred, ((top, latents - top - 120), (0, 0), (0, 0)), mode="edge")
for _ in range(25):
    latent = latent - blur.adjoint(blur.forward(latent) - blurred)
    latent = denoise_tv_chambolle(latent, weight=0.004, channel_axis=2).astype(np.float32)
plugged = latent[top : top + 120]

# %%
# The built-in priors solve the problem in the frequency domain, with fewer steps:

built_in = rsdeblur.deblur(blurred, log, camera, exposure, mode="rowwise").image
pictures = {"blurred": blurred, "denoiser, 25 steps": plugged, "rowwise, tv": built_in, "sharp": truth}
axes = rsdeblur.plot.comparison(pictures, reference=truth)
