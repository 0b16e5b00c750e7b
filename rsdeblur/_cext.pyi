from typing import Final

import numpy as np
from numpy.typing import NDArray

SIMD: Final[str]

def multiply(spectra: NDArray[np.complex64], responses: NDArray[np.complex64], /) -> None: ...
def add_normal(
    spectra: NDArray[np.complex64],
    otfs: NDArray[np.complex64],
    share: float,
    first: bool,
    signal: NDArray[np.complex64],
    power: NDArray[np.float32],
    /,
) -> None: ...
def solve_normal(*arguments: NDArray[np.generic] | float) -> None: ...
def blend(
    accumulator: NDArray[np.complex64],
    slabs: NDArray[np.complex64],
    weights: NDArray[np.float32],
    spans: NDArray[np.int32],
    /,
) -> None: ...
def unpair(
    pairs: NDArray[np.complex64], turns: NDArray[np.complex64], spectra: NDArray[np.complex64], top: int, /
) -> None: ...
def pair(
    spectra: NDArray[np.complex64], top: int, turns: NDArray[np.complex64], pairs: NDArray[np.complex64], /
) -> None: ...
def picture_to_lines(
    picture: NDArray[np.float32],
    top: int,
    rows: int,
    start: int,
    fade: NDArray[np.float32],
    periodic: bool,
    lines: NDArray[np.float32],
    /,
) -> bool: ...
def lines_to_picture(
    lines: NDArray[np.float32],
    rows: int,
    offset: int,
    weights: NDArray[np.float32],
    first: int,
    add: bool,
    picture: NDArray[np.float32],
    top: int,
    /,
) -> None: ...
def rows_to_columns(
    rows: NDArray[np.complex64], first: int, height: int, columns: NDArray[np.complex64], /
) -> None: ...
def columns_to_rows(
    columns: NDArray[np.complex64], rows: NDArray[np.complex64], first: int, height: int, /
) -> None: ...
def cut_lines(
    columns: NDArray[np.complex64],
    height: int,
    starts: NDArray[np.int32],
    fade: NDArray[np.float32],
    periodic: bool,
    slabs: NDArray[np.complex64],
    /,
) -> None: ...
def shrunk_grad_adjoint(*arguments: NDArray[np.float32] | float) -> None: ...
def shrunk_derivatives_adjoint(*arguments: NDArray[np.float32] | float) -> None: ...
def fit_tiles(*arguments: NDArray[np.generic] | float) -> None: ...
def rowwise_forward(*arguments: NDArray[np.generic]) -> None: ...
def rowwise_adjoint(*arguments: NDArray[np.generic]) -> None: ...
def rowwise_solve(*arguments: NDArray[np.generic] | float) -> None: ...
def rowwise_assemble(*arguments: NDArray[np.generic] | int) -> None: ...
def rowwise_solve_assembled(*arguments: NDArray[np.generic] | float) -> None: ...
def rowwise_assembled_size(*arguments: NDArray[np.generic] | int) -> int: ...
def rowwise_workspace(*arguments: NDArray[np.generic] | int) -> int: ...
