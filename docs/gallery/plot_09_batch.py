"""
A batch of captures
===================

Many captures, one table: the blur, the verdict of the check and, since these are simulated, the gain. Files are
better served by ``rsdeblur batch``, which resumes and uses several processes.
"""

import numpy as np

import rsdeblur
import rsdeblur.plot

scene = rsdeblur.scene(200, 270)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.2, duration=1 / 20)


def psnr(picture, truth):
    """Return the PSNR in sRGB values, dB."""
    a, b = (rsdeblur.from_linear(np.clip(each, 0, 1), "srgb") for each in (picture, truth))
    return -10 * np.log10(np.mean((a - b) ** 2))


# %%

print("seed   PSF px    blurred  deblurred  verdict")
for seed in range(4):
    log = rsdeblur.hand_shake(0.6, strength=0.4, seed=seed)
    blurred, _, truth = rsdeblur.simulate(scene, log, camera, exposure, noise=0.005, seed=seed)
    result = rsdeblur.deblur(blurred, log, camera, exposure)
    size = "{1} x {0}".format(*result.psfs.size)
    gain = f"{psnr(blurred, truth):6.1f} dB  {psnr(result.image, truth):6.1f} dB"
    print(f"{seed:4}  {size:>8}  {gain}  {result.check.verdict}")

# %%
# The last one:

axes = rsdeblur.plot.comparison({"blurred": blurred, "deblurred": result, "sharp": truth}, reference=truth)
