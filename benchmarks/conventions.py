"""Test of the conventions on a real photo: ``python -m benchmarks.conventions [--pictures FOLDER]``.

The burst frame 0004.jpg is deblurred with the documented conventions and with each one reversed. Two measures:

- **roughness**: mean gradient magnitude of the result (linear light, mean of the channels, border left out), times
  1000. All variants undo about the same amount of blur. A wrong PSF adds ringing, so the right one is the least rough.
- **lean**: lean of the near-vertical edges of the *rectified* picture, degrees (peak of the histogram of edge
  directions within 30 degrees of upright, weighted with squared gradients). The photo shows a bookcase, held about
  level. The pan shears it by some 6 degrees, and the wrong row order doubles that instead of undoing it.

The exit code is 1 if the documented conventions are not best in both.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from benchmarks.captures import Image, shield_burst
from rsdeblur import Camera, GyroLog, deblur
from rsdeblur.image.transfer import from_linear
from rsdeblur.io import write_picture

# Both measures leave out the border: the blur is 100 px wide.
INSIDE = np.s_[60:-60, 160:-160]
NSR = {"roughness": 0.01, "lean": 0.03}


def main() -> None:
    """Print both measures for every variant."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, help="also write the pictures to this folder")
    options = parser.parse_args()
    image, log, camera, exposure = shield_burst()
    results = {}
    print(f"{'variant':22s} roughness   lean")
    print(f"{'(blurred input)':22s} {roughness(image):9.3f} {lean(image):6.1f}")
    for name, variant_log, variant_camera in variants(log, camera):
        recording = variant_log, variant_camera, exposure
        keep = deblur(image, *recording, nsr=NSR["roughness"], prior="wiener").image
        rectified = deblur(image, *recording, nsr=NSR["lean"], geometry="rectify", prior="wiener").image
        results[name] = roughness(keep), lean(rectified)
        print(f"{name:22s} {results[name][0]:9.3f} {results[name][1]:6.1f}", flush=True)
        if options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
            for kind, picture in (("keep", keep), ("rectify", rectified)):
                target = options.pictures / f"{name.replace(' ', '-')}-{kind}.png"
                write_picture(target, from_linear(picture.clip(0, 1), "srgb"), force=True)
    right = results.pop("as documented")
    if any(right[0] >= r or abs(right[1]) >= abs(tilt) for r, tilt in results.values()):
        sys.exit("the documented conventions are not the best in both measures")
    print("the documented conventions are the best in both measures")


def variants(log: GyroLog, camera: Camera) -> Iterator[tuple[str, GyroLog, Camera]]:
    """Yield the documented conventions first, then each one reversed."""
    yield "as documented", log, camera
    for axis, name in enumerate("xyz"):
        signs = np.ones(3)
        signs[axis] = -1.0
        yield f"{name} rate reversed", replace(log, omega=log.omega * signs), camera
    yield "row order reversed", log, replace(camera, readout_direction="bottom-up")


def roughness(image: Image) -> float:
    """Return the mean gradient magnitude, times 1000."""
    grey = image.mean(axis=2)[INSIDE]
    return 1000 * float(np.hypot(np.diff(grey, axis=1)[:-1], np.diff(grey, axis=0)[:, :-1]).mean())


def lean(image: Image, *, reach: float = 30.0, step: float = 0.5) -> float:
    """Return the lean of the near-vertical edges, degrees from upright, positive if the top leans left."""
    grey = ndimage.gaussian_filter(from_linear(image.clip(0, 1), "srgb").mean(axis=2), 3)[INSIDE]
    gx, gy = ndimage.sobel(grey, axis=1), ndimage.sobel(grey, axis=0)
    angle = np.degrees(np.arctan2(-gy * np.sign(gx), np.abs(gx)))
    edges = np.arange(-reach, reach + step, step)
    histogram, _ = np.histogram(angle, bins=edges, weights=gx**2 + gy**2)
    # Smoothed by 1.5 degrees, so that a peak is found and not a spike.
    return float(edges[ndimage.gaussian_filter1d(histogram, 3).argmax()] + step / 2)


if __name__ == "__main__":
    main()
