"""Suite for airspeed velocity; ``asv run --python=same --quick`` from the repository root runs it as installed."""

import sys
from pathlib import Path

# asv imports this folder alone. Last, or the bare source folder would hide the installed package.
sys.path.append(str(Path(__file__).resolve().parents[2]))
