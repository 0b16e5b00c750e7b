from .plug_and_play import PlugAndPlayPrior as PlugAndPlayPrior
from .priors import DerivativePrior as DerivativePrior
from .quadratic import TileQuadratic as TileQuadratic
from .rowwise import RowDeconvolver as RowDeconvolver
from .rowwise_blur import RowBlur as RowBlur

__all__: list[str]
