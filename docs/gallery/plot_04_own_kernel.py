"""
Your own kernel
===============

A blur that was measured or computed elsewhere needs neither log nor camera: :func:`rsdeblur.deconvolve` takes the
kernel.
"""

import numpy as np
from scipy.ndimage import convolve
from skimage.restoration import wiener

import rsdeblur
import rsdeblur.plot

# %%
# An almost straight trail of 41 px, and a picture blurred with it. Light from beyond the frame has moved in:

kernel = np.zeros((9, 41))
for t in np.linspace(0, 1, 200):
    kernel[round(8 * t**2), round(40 * t)] += 1 / 200
scene = rsdeblur.scene(200, 300).mean(axis=2)
frame = np.s_[16:-16, 38:-38]
sharp = scene[frame]
blurred = convolve(scene, kernel)[frame] + np.random.default_rng(0).normal(0, 0.003, sharp.shape)

# %%
# scikit-image takes the same kernel. Its filter treats the picture as periodic, so its borders ring far into it. Ours
# blends opposite borders, or, with any prior but the Wiener filter, solves for what lies beyond the frame. That is the
# default for your own kernels:

pictures = {
    "blurred": blurred,
    "scikit-image, wiener": wiener(blurred, kernel, balance=0.01, clip=False),
    "rsdeblur, wiener": rsdeblur.deconvolve(blurred, kernel, prior="wiener"),
    "rsdeblur, blended border": rsdeblur.deconvolve(blurred, kernel, border="blend"),
    "rsdeblur": rsdeblur.deconvolve(blurred, kernel),
}
axes = rsdeblur.plot.comparison(pictures, reference=sharp)
