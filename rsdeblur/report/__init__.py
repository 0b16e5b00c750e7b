"""Drawings of results: maps of PSFs and pictures side by side. The pages of commands are in its other modules."""

from rsdeblur.report.drawings import psf_map, side_by_side

__all__ = ["psf_map", "side_by_side"]
