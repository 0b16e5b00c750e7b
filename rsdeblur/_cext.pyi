from typing import Final

import numpy as np
from numpy.typing import NDArray

SIMD: Final[str]

def multiply(spectra: NDArray[np.complex64], transfer: NDArray[np.complex64]) -> None: ...
def blend(
    accumulator: NDArray[np.complex64],
    slab: NDArray[np.complex64],
    weights: NDArray[np.float32],
    *,
    to_position: int,
    from_position: int,
) -> None: ...
def rowwise_forward(*arguments: NDArray[np.generic]) -> None: ...
def rowwise_adjoint(*arguments: NDArray[np.generic]) -> None: ...
def rowwise_solve(*arguments: NDArray[np.generic] | float) -> None: ...
def rowwise_workspace(*arguments: NDArray[np.generic] | int) -> int: ...
