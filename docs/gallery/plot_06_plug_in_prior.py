"""
Plug in a denoiser
==================

Any function that removes noise from a picture can be the prior: :func:`rsdeblur.deblur` alternates it with its own
exact solves, in every mode.
"""

from skimage.restoration import denoise_tv_chambolle

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=1)
camera = rsdeblur.Camera(160, 120, 150.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(150, 200), log, camera, exposure, noise=0.01)

# %%
# The function gets a picture in linear light, and the standard deviation of the noise to remove:


def denoise(image, sigma):
    """Return the picture without noise of the standard deviation sigma."""
    return denoise_tv_chambolle(image, weight=sigma, channel_axis=2)


plugged = rsdeblur.deblur(blurred, log, camera, exposure, mode="rowwise", prior=denoise)
print(f"weight {plugged.weight:.2g}, from a noise of {plugged.noise:.2g}")

# %%
# The hyper-Laplacian is the default:

default = rsdeblur.deblur(blurred, log, camera, exposure, mode="rowwise")
pictures = {"blurred": blurred, "denoise": plugged, "hyper-laplacian": default}
axes = rsdeblur.plot.comparison(pictures | {"sharp": truth}, reference=truth)

# %%
# An algorithm of your own can use the blur itself, a linear operator with an adjoint:

capture = rsdeblur.motion.Capture.from_log(log, camera, exposure)
blur = rsdeblur.deconv.RowBlur(rsdeblur.motion.BlurPaths.every_row(capture, cols=[40, 120]), width=160, channels=3)
residual = blur.forward(blur.adjoint(blurred)) - blurred
print(blur, residual.shape)
