"""The local page that deblurs while its sliders move: its server, and the solver of a crop."""

from rsdeblur.app.crop import Basis, Crop, derive_basis, solve_crop
from rsdeblur.app.server import LocalServer, app_page

__all__ = ["Basis", "Crop", "LocalServer", "app_page", "derive_basis", "solve_crop"]
