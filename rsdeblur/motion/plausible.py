"""Values of a camera that are possible, but are probably mistakes."""

from __future__ import annotations

import math

from rsdeblur.motion.camera import Camera

# Degrees along the longer side. Without fisheye distortion no lens for photos sees more; long telescopes see less.
WIDEST, NARROWEST = 150.0, 3.0
# s. The slowest sensors of cameras take 0.1 s.
LONGEST_READOUT = 0.2


def doubts(camera: Camera) -> list[str]:
    """Return a sentence for each value that is probably a mistake, with the probable intent."""
    found = [] if (wide := too_wide(camera)) is None else [wide]
    fx, fy = camera.focal_length
    if (view := _field_of_view(camera)) < NARROWEST:
        found.append(
            f"a focal length of {max(fx, fy):g} px means a field of view of {view:.2g} degrees; was it measured in a "
            "larger picture?"
        )
    if camera.readout_time > LONGEST_READOUT:
        seconds = camera.readout_time
        found.append(f"a readout time of {seconds:g} s is longer than that of any camera; did you mean {seconds:g} ms?")
    return found


def too_wide(camera: Camera) -> str | None:
    """Return why the focal length is probably not in px; None if it may be."""
    view = _field_of_view(camera)
    if camera.distortion_model == "fisheye" or view <= WIDEST:
        return None
    return (
        f"a focal length of {min(camera.focal_length):g} px means a field of view of {view:.1f} degrees; is it in mm? "
        "It must be in px: give the 35 mm equivalent (rsdeblur camera new --focal35), or divide it by the width of a "
        "pixel on the sensor"
    )


def _field_of_view(camera: Camera) -> float:
    """Return the angle along the longer side in degrees, without distortion."""
    fx, fy = camera.focal_length
    return math.degrees(2 * math.atan(max(camera.width / fx, camera.height / fy) / 2))
