"""
Calibrate a camera from a clip
==============================

:func:`rsdeblur.calibrate` compares the motion between the frames of a clip with the log. Axes, clock, readout and focal
length need not be known. Here they are, because the clip is simulated.
"""

import rsdeblur
import rsdeblur.plot

true = rsdeblur.Camera(320, 240, 350.0, readout_time=0.02, imu_to_camera="phone-landscape", time_offset=0.1)
exposures = [rsdeblur.Exposure(0.5 + i / 30, 1 / 200) for i in range(12)]
log = rsdeblur.hand_shake(2.0, strength=0.3, seed=1)
frames = list(rsdeblur.simulate_clip(rsdeblur.scene(360, 480), log, true, exposures, noise=0.005))
axes = rsdeblur.plot.comparison({f"frame {i}": frames[i] for i in (0, 4, 8)})

# %%
# The start value of the focal length is 14 % too short; all else is left at its default:

found = rsdeblur.calibrate(frames, exposures, log, rsdeblur.Camera(320, 240, 300.0))
print(found.accepted, found.mounting, found.camera)
print(f"{'value':>14}  {'found':>9}  {'sd':>8}  {'true':>8}")
truth = {"time_offset": 0.1, "focal_length": 350.0, "readout_time": 0.02}
for name, value in truth.items():
    estimate = found.values[name]
    deviation = f"{estimate.sd:8.2g}" if estimate.determined else "   start"
    print(f"{name:>14}  {estimate.value:9.4g}  {deviation}  {value:8.4g}  {estimate.unit}")
