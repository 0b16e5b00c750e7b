"""
Sweep of the noise-to-signal ratio
==================================

The Wiener filter has one number, ``nsr``: larger values give smoother results. A solver is planned for one value; the
automatic choice comes from the noise that :func:`rsdeblur.deblur` measures in the picture.
"""

import matplotlib.pyplot as plt
import numpy as np

import rsdeblur

log = rsdeblur.hand_shake(0.6, strength=0.5, seed=1)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(200, 270), log, camera, exposure, noise=0.01)

# %%
# Kernels once, then a solver for each value. Pictures of the solver are linear light, and so is the simulation:

bank = rsdeblur.psfs(log, camera, exposure)
values = np.geomspace(1e-4, 1, 9)


def psnr(picture):
    """Return the PSNR of a picture in sRGB values, dB."""
    error = rsdeblur.from_linear(np.clip(picture, 0, 1), "srgb") - rsdeblur.from_linear(truth, "srgb")
    return -10 * np.log10(np.mean(error**2))


scores = [psnr(rsdeblur.Deconvolver(bank, blurred.shape, nsr=nsr).apply(blurred)) for nsr in values]

# %%
# The automatic value lies near the best:

result = rsdeblur.deblur(blurred, log, camera, exposure, prior="wiener", check=False)
_, ax = plt.subplots(layout="constrained")
ax.semilogx(values, scores, "o-", label="fixed")
ax.semilogx(result.nsr, psnr(result.image), "s", label=f"automatic, {result.nsr:.2g}")
ax.axhline(psnr(blurred), color="0.6", linestyle="--", label="blurred picture")
ax.set(xlabel="nsr", ylabel="PSNR, dB")
legend = ax.legend()
