"""
Your own kernel
===============

A blur that was measured or computed elsewhere needs neither log nor camera: :func:`rsdeblur.deconvolve` takes the
kernel.
"""

import numpy as np
from scipy.ndimage import convolve
from skimage.restoration import unsupervised_wiener, wiener

import rsdeblur
import rsdeblur.plot

# %%
# A bent trail of 15 px, and a picture blurred with it. ``mode="nearest"`` continues the scene:

kernel = np.zeros((9, 15))
for t in np.linspace(0, 1, 60):
    kernel[round(8 * t**2), round(14 * t)] += 1 / 60
sharp = rsdeblur.scene(168, 224).mean(axis=2)
blurred = convolve(sharp, kernel, mode="nearest") + np.random.default_rng(0).normal(0, 0.005, sharp.shape)

# %%
# scikit-image takes the same kernel. Its filter treats the picture as periodic, so its borders ring:

pictures = {
    "blurred": blurred,
    "scikit-image, wiener": wiener(blurred, kernel, balance=0.01, clip=False),
    "scikit-image, unsupervised": unsupervised_wiener(blurred, kernel, clip=False)[0],
    "rsdeblur, wiener": rsdeblur.deconvolve(blurred, kernel, prior="wiener").image,
    "rsdeblur, tv": rsdeblur.deconvolve(blurred, kernel).image,
}
axes = rsdeblur.plot.comparison(pictures, reference=sharp)
