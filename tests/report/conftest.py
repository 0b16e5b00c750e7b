"""A small report for the tests of the page."""

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, PsfBank
from rsdeblur.io import Picture
from rsdeblur.report.page import Page


@pytest.fixture(scope="session")
def report_page(shaky_log):
    """Builder of a small report: a red input, a green and a blue result of 160x120 px, read in 30 ms from 0.1 s on."""

    def build(*, photo: str = "photo.png", remark: str = "", direction: str = "top-down") -> Page:
        shown = {name: np.zeros((120, 160, 3), np.float32) for name in ("input", "global", "banded")}
        for channel, picture in enumerate(shown.values()):
            picture[..., channel] = 0.6
        bar = np.zeros((5, 9))
        bar[2] = 1 / 9
        mode = {"prior": "tv", "bands": 3, "strips": 2, "psf_px": [9, 5], "nsr": 0.01, "weight": None, "seconds": 1.25}
        mode |= {"timings": {"plan": 0.25, "apply": 1.0}, "check": None}
        check = {"verdict": "doubtful", "reasons": ["Ringing."], "ringings": [0.01] * 6}
        return Page(
            report={"photo": photo, "modes": {"global": mode, "banded": mode | {"check": check}}},
            picture=Picture(np.zeros((120, 160), np.uint8)),
            log=shaky_log(),
            camera=Camera(160, 120, 180.0, readout_time=0.03, readout_direction=direction),
            exposure=Exposure(0.1, 0.04),
            shown=shown,
            banks={
                "global": PsfBank.for_picture(bar, (120, 160)),
                "banded": PsfBank.for_picture(np.tile(bar, (3, 2, 1, 1)), (120, 160)),
            },
            transfer="srgb",
            settings={"Recording": {"gyro": photo}},
            remarks=[("Warning", remark)] if remark else [],
        )

    return build
