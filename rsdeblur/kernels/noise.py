"""One step of the fit of noise and model error to the periodograms of tiles (:mod:`rsdeblur.tuning.noise`)."""

from rsdeblur.kernels._jit import njit


# Sums in any order, so that the loops become SIMD code; NaN and infinity stay what they are.
@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def fit_cells(measured, blurred, error, cells, floors, squared, gains, sums):
    """Update the gains (T, C) of T tiles in C cells of frequencies, and fill `sums` (4, T, C) under the new ones.

    The power expected is `V = gain (blurred + squared error) + floor`, with `blurred` and `measured` (T, F), `error`
    (F,) and `floors` (T, C), all C-contiguous; `cells` has the first frequency of each cell, and F. The sums over cells
    are those of P / V^2 and 1 / V, where P is `measured`, and of the same times `gain error`.
    """
    for tile in range(gains.shape[0]):
        for cell in range(gains.shape[1]):
            first, last, floor, gain = cells[cell], cells[cell + 1], floors[tile, cell], gains[tile, cell]
            # Slices, because of indices that may be negative the compiler makes no SIMD code.
            power, light, wrong = measured[tile, first:last], blurred[tile, first:last], error[first:last]
            more, less, up, down, error_up, error_down = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(len(power)):
                scene = light[i] + squared * wrong[i]
                known = 1.0 / (gain * scene + floor)
                more += power[i] * known * known * scene
                less += known * scene
            gain *= more / less
            for i in range(len(power)):
                known = 1.0 / (gain * (light[i] + squared * wrong[i]) + floor)
                surprise = power[i] * known * known
                up += surprise
                down += known
                error_up += surprise * wrong[i]
                error_down += known * wrong[i]
            gains[tile, cell] = gain
            sums[0, tile, cell], sums[1, tile, cell] = up, down
            sums[2, tile, cell], sums[3, tile, cell] = gain * error_up, gain * error_down
