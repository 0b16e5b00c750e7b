"""How clearly noise has the colour that denoising leaves: ``python -m benchmarks.noise [PHOTO ...]``.

Photos, and the fourteen captures with white noise of 40 dB: in linear light, as JPEG, and as a phone processes them.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.captures import simulated
from benchmarks.phone import from_phone
from benchmarks.priors import jpeg, noisy
from benchmarks.tables import markdown
from rsdeblur import PsfBank, read_picture
from rsdeblur.estimate.floors import measure_floors
from rsdeblur.image.encoded import EncodedImage


def processed(light: np.ndarray) -> float:
    """Return `Floors.processed` of a picture, which does not depend on its blur; not a number if it has no noise."""
    floors = measure_floors(light.astype(np.float32), PsfBank.for_picture(np.ones((1, 1)), light.shape[:2]))
    return np.nan if floors is None else floors.processed


if __name__ == "__main__":
    pictures = {path: EncodedImage.of(read_picture(path).pixels, "auto").linear(slice(None)) for path in sys.argv[1:]}
    rows = [(path, f"{processed(light):.2f}") for path, light in pictures.items()]
    shares = []
    for n, clean in enumerate(simulated(noise=0.0, enlarged=1)):
        white = noisy(clean, 40).pictures.blurred
        shares.append([processed(each) for each in (white, jpeg(white), from_phone(clean, n).pictures.blurred)])
    for name, column in zip(("white noise", "as JPEG", "as by a phone"), np.transpose(shares), strict=True):
        rows.append((f"captures, {name}", f"{column.mean():.2f} ({column.min():.2f} to {column.max():.2f})"))
    print(markdown(("picture", "processed"), rows))
