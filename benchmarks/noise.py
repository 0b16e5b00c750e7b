"""How clearly noise has the colour that denoising leaves, `Floors.processed`: ``python -m benchmarks.noise``.

Fourteen captures with white noise of 40 and 50 dB in linear light, the first as JPEG, and as a phone processes them.
"""

from __future__ import annotations

import numpy as np

from benchmarks.captures import simulated
from benchmarks.phone import from_phone
from benchmarks.priors import jpeg, noisy
from benchmarks.tables import markdown
from rsdeblur.motion import Capture
from rsdeblur.pipeline.tiles import few_psfs
from rsdeblur.tuning.noise import measure_floors

if __name__ == "__main__":
    shares = []
    for n, clean in enumerate(simulated(noise=0.0, enlarged=1)):
        white, little = (noisy(clean, decibels).pictures.blurred for decibels in (40, 50))
        lights = white, little, jpeg(white), from_phone(clean, n).pictures.blurred
        bank = few_psfs(Capture.from_log(*clean.recording), threads=None)
        floors = [measure_floors(light, bank.without_softness()) for light in lights]
        shares.append([0.0 if each is None else each.processed for each in floors])
    names = "white noise, 40 dB", "white noise, 50 dB", "40 dB as JPEG", "as by a phone"
    rows = [
        (name, f"{column.mean():.2f}", f"{column.min():.2f}", f"{column.max():.2f}")
        for name, column in zip(names, np.transpose(shares), strict=True)
    ]
    print(markdown(("pictures", "mean", "least", "most"), rows))
