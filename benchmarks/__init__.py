"""Benchmarks and experiments; run them from the repository root with ``python -m benchmarks.<name>``."""

import sys
from pathlib import Path

# `python -m` puts the repository root first, where the bare source folder would hide the installed package.
_root = Path(__file__).resolve().parents[1]
sys.path.sort(key=lambda entry: Path(entry).resolve() == _root)
