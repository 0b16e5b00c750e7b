"""What the installed extras allow to test."""

from importlib.util import find_spec
from typing import Any

import pytest

from rsdeblur import choices

# The module that shows whether an extra is installed.
MODULES = {
    "plot": "matplotlib.pyplot",
    "telemetry": "telemetry_parser",
    "kalibr": "yaml",
    "heif": "pillow_heif",
    "raw": "rawpy",
    "gyroflow": "cbor2",
    "video": "av",
    "cnn": "onnxruntime",
    "browser-test": "playwright.sync_api",
    "bench": "cv2",
}
# The priors that can run.
PRIORS = tuple(prior for prior in choices.PRIORS if prior != "cnn" or find_spec(MODULES["cnn"]))


def needs(extra: str) -> Any:
    """Return the module of an extra; skip the test, or the file that calls this at import, where it is missing."""
    return pytest.importorskip(MODULES[extra], reason=f"needs rsdeblur[{extra}]")
