"""Suite for airspeed velocity. ``asv run --python=same --quick`` from the root tests the installed package."""

import sys
from pathlib import Path

# asv imports only this folder. The root goes last on the path, or the bare source folder would hide the installed
# package.
sys.path.append(str(Path(__file__).resolve().parents[2]))
