"""The local page that deblurs while its sliders move: server, page, and the solver of a crop."""

from rsdeblur.app.crop import Basis, Crop, derive_basis, solve_crop
from rsdeblur.app.page import page_files
from rsdeblur.app.server import LocalServer

__all__ = ["Basis", "Crop", "LocalServer", "derive_basis", "page_files", "solve_crop"]
