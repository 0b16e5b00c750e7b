"""Drawings of results: the kernels where they belong, pictures side by side, and contact sheets."""

from rsdeblur.report.contact_sheet import contact_sheet
from rsdeblur.report.psf_map import psf_map
from rsdeblur.report.side_by_side import side_by_side

__all__ = ["contact_sheet", "psf_map", "side_by_side"]
