"""Drawings of results: the kernels where they belong, and pictures side by side."""

from rsdeblur.report.psf_map import psf_map
from rsdeblur.report.side_by_side import side_by_side

__all__ = ["psf_map", "side_by_side"]
