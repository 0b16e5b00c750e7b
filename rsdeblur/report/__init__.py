"""Drawings of results: maps of PSFs, pictures side by side, contact sheets, and the page of the report."""

from rsdeblur.report.bands import BandFigures, band_figures
from rsdeblur.report.batch_page import write_batch_page
from rsdeblur.report.contact_sheet import contact_sheet
from rsdeblur.report.embed import MotionPlot
from rsdeblur.report.findings import Finding, findings
from rsdeblur.report.page import Page, write_page
from rsdeblur.report.psf_map import psf_map
from rsdeblur.report.side_by_side import side_by_side

__all__ = [
    "BandFigures",
    "Finding",
    "MotionPlot",
    "Page",
    "band_figures",
    "contact_sheet",
    "findings",
    "psf_map",
    "side_by_side",
    "write_batch_page",
    "write_page",
]
