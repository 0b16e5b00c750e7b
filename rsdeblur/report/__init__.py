"""Drawings of results: maps of PSFs, pictures side by side, contact sheets, and pages of HTML."""

from rsdeblur.report.drawings import psf_map, side_by_side
from rsdeblur.report.page import Page, write_batch_page, write_page

__all__ = ["Page", "psf_map", "side_by_side", "write_batch_page", "write_page"]
