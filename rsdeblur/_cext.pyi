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
