"""
Find the clock offset in a picture
==================================

Camera and gyroscope often have clocks that differ. :func:`rsdeblur.find_time_offset` finds the offset that makes the
picture's spectra likeliest, or reports that the picture does not determine it.
"""

import matplotlib.pyplot as plt

import rsdeblur
import rsdeblur.plot

log = rsdeblur.hand_shake(1.0, strength=0.6, seed=4)
camera = rsdeblur.Camera(224, 168, 210.0, readout_time=0.03)
exposure = rsdeblur.Exposure(start=0.4, duration=1 / 20)
blurred, _, truth = rsdeblur.simulate(rsdeblur.scene(200, 270, seed=2), log, camera, exposure, noise=0.005)

# %%
# Let the log's clock be 21 ms late:

late = log.shifted(0.021)
search = rsdeblur.find_time_offset(blurred, late, camera, exposure, search=(-0.04, 0.04))
print(f"{1e3 * search.time_offset:.1f} +- {1e3 * search.sd:.1f} ms")

_, ax = plt.subplots(figsize=(6, 3), layout="constrained")
ax.plot(1e3 * search.offsets, search.scores)
ax.axvline(-21, color="tab:red", linestyle="--", label="true offset")
ax.set(xlabel="offset, ms", ylabel="less likely by, nats")
legend = ax.legend()

# %%
# ``best`` is the likeliest offset whether it is accepted or not:

corrected = late.shifted(search.best)
pictures = {
    "blurred": blurred,
    "wrong clock": rsdeblur.deblur(blurred, late, camera, exposure),
    "corrected": rsdeblur.deblur(blurred, corrected, camera, exposure),
}
axes = rsdeblur.plot.comparison(pictures, reference=truth)
