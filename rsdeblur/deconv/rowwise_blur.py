"""The rolling-shutter blur, exact for every row, and its adjoint.

Row y of the recorded picture is the gather `g(p) = mean_t u(p - d(y, t))` over the path of row y. Transformed along x,
where the blur of a strip does not change, it is a sum over latent rows j for each frequency k:

    G[y] = sum_j A[y, j] U[j],    A[y, j] = mean_t w(y - d_y(y, t) - j) exp(-2 pi i k d_x(y, t) / N)

where w interpolates between rows by a windowed sinc; between columns, PSFs are drawn with the same window. Row y
touches only the rows that its own path visits. Some of them lie beyond the frame, so the latent picture is taller than
the recorded one, and nothing wraps around in y.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import ThreadTeam, share_map, thread_count
from rsdeblur.deconv.fft import RowTransform
from rsdeblur.deconv.tiling import Tile, fade, hat_weights
from rsdeblur.errors import InputError
from rsdeblur.kernels import lines, rowwise
from rsdeblur.kernels.raster import SINC_WIDTH, WIDTH, interpolated
from rsdeblur.kernels.rowwise import BLOCK, RowModel
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.types import ComplexArray, Float32Array, FloatArray

if TYPE_CHECKING:
    from scipy.sparse.linalg import LinearOperator

# Picture rows per block.
ROWS = 16
# Rows drawn at a time, which bounds the memory for their dense kernels.
ROWS_TOGETHER = 256


class RowSpectra:
    """Row transforms of one length, px, with the buffers of each thread, in the layout of the rowwise kernels.

    Every frequency is an independent problem along y. One thread works on a block of 16 frequencies, one per SIMD lane,
    so arrays in this layout are called lanes. Any number of threads gives the same bits.
    """

    def __init__(self, channels: int, length: int, *, threads: int) -> None:
        self.channels, self.length, self.team = channels, length, ThreadTeam(threads)
        self.blocks = -(-(length // 2 + 1) // rowwise.LANES)
        self._columns = self.blocks * rowwise.LANES
        self._rows = [
            RowTransform((channels, ROWS, length), empty((channels, ROWS, self._columns), np.complex64))
            for _ in range(threads)
        ]

    def empty(self, rows: int) -> Float32Array:
        """Return zeroed lanes for `rows` rows; frequencies that only fill up the last block stay zero."""
        lanes: Float32Array = empty((self.blocks, self.channels, rows, 2, rowwise.LANES), np.float32)
        lanes[...] = 0
        return lanes

    def load(
        self, picture: Float32Array, lanes: Float32Array, *, start: int = 0, taper: int = 0, periodic: bool = True
    ) -> None:
        """Transform the rows of `picture` (H, W, C), read from column `start` on, into `lanes`."""
        ramp = fade(taper)
        height = lanes.shape[2]

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, height - top), self._rows[thread]
            lines.picture_to_lines(picture, top, rows, start, ramp, periodic, buffers.real)
            buffers.forward()
            spectra, part = self._by_block(buffers.spectra, rows), lanes[:, :, top : top + rows]
            part[..., 0, :], part[..., 1, :] = spectra.real, spectra.imag

        self.team.share(block, range(0, height, ROWS))

    def _by_block(self, spectra: ComplexArray, rows: int) -> ComplexArray:
        """Return a view of the first `rows` of spectra, shape (blocks, C, rows, 16)."""
        return spectra[:, :rows].reshape(self.channels, rows, self.blocks, rowwise.LANES).transpose(2, 0, 1, 3)

    def unload(self, lanes: Float32Array, first: int, out: Float32Array, tile: Tile, *, add: bool = False) -> None:
        """Transform `lanes` back from row `first` on; write to `out` (H, W, C), or add, where `tile` contributes."""
        weights = tile.weights * np.float32(1 / self.length)

        def block(thread: int, top: int) -> None:
            rows, buffers = min(ROWS, len(out) - top), self._rows[thread]
            spectra, part = self._by_block(buffers.spectra, rows), lanes[:, :, first + top : first + top + rows]
            spectra.real, spectra.imag = part[..., 0, :], part[..., 1, :]
            buffers.inverse()
            lines.lines_to_picture(buffers.real, rows, tile.first - tile.start, weights, tile.first, add, out, top)

        self.team.share(block, range(0, len(out), ROWS))


@dataclass(frozen=True, slots=True, eq=False)
class StripBlur:
    """Blur of every row in one strip, as taps that do not depend on the picture's width."""

    model: RowModel
    rows: int  # of the recorded picture, or of all pictures of a burst
    first_shift: int  # smallest shift along x, px
    shifts: int  # number of shifts

    @classmethod
    def from_frames(
        cls,
        frames: Sequence[BlurPaths],
        factors: Sequence[float],
        strip: int,
        top: int,
        latents: int,
    ) -> StripBlur:
        """Draw the PSF of every row of `strip`, and sort it by latent row; they are `latents` rows from `top` on.

        N frames are drawn as one picture, whose row N y + i is row y of frame i times `factors[i]`.
        """
        parts, rows = [], len(frames) * len(frames[0].rows)
        for i, (paths, factor) in enumerate(zip(frames, factors, strict=True)):
            row, down, across, weight = _draw(paths.displacements[:, strip], paths.softness)
            # A PSF weighs displacements d = p - q of the recorded from the latent point.
            parts.append((len(frames) * row + i, row - down - top, across, np.float32(factor) * weight))
        row, latent, across, weight = (np.concatenate(values) for values in zip(*parts, strict=True))
        first = int(across.min())
        model = _sorted(row, latent, across - first, weight, latents, rows)
        return cls(model, rows, first, int(across.max()) - first + 1)

    def table(self, block: int, length: int) -> Float32Array:
        """Return the phases of the shifts at the 16 frequencies of `block`."""
        return rowwise.phase_table(block, self.first_shift, self.shifts, length)

    def workspace_size(self, *, solve: bool) -> int:
        """Return the number of floats of workspace that one thread needs to apply the blur, or to solve with it."""
        return rowwise.workspace_size(self.model, self.table(0, 1), self.rows, solve)


@one_line("picture_shape", "latent_shape", "top")
class RowBlur:
    """Row-exact blur of a rolling-shutter picture as a linear operator, and its adjoint.

    The picture repeats along x. Strips are blended linearly between their centres.

    Parameters
    ----------
    paths : BlurPaths
        Paths of every row of the picture (:meth:`rsdeblur.motion.BlurPaths.every_row`), in one or more strips.
    width : int
        Width of the picture, px.
    channels : int, default 1
        Channels of the pictures; each has the same blur.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Attributes
    ----------
    picture_shape, latent_shape : (H, W, C) and (L, W, C)
        Shapes of the recorded and of the latent picture.
    top : int
        Row of the recorded picture at which the first latent row lies; 0 or less.

    Raises
    ------
    InputError
        If `paths` do not belong to the rows 0, 1, 2 and so on and to columns that increase, a count is not a positive
        whole number, or a picture has another shape, or a value that is not finite or beyond 1e12.

    Examples
    --------
    The adjoint fits the forward operator:

    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> blur = rsdeblur.deconv.RowBlur(rsdeblur.motion.BlurPaths.every_row(capture, cols=[31.5]), width=64)
    >>> u, g = np.ones(blur.latent_shape), np.ones(blur.picture_shape)
    >>> bool(np.isclose((blur.forward(u) * g).sum(), (u * blur.adjoint(g)).sum()))
    True
    """

    def __init__(self, paths: BlurPaths, width: int, *, channels: int = 1, threads: int | None = None) -> None:
        validate.instance("paths", paths, BlurPaths)
        width = validate.count("width", width, maximum=validate.MOST_VALUES)
        channels = validate.count("channels", channels, maximum=validate.MOST_VALUES)
        self.top, latents = latent_rows(paths)
        height, width, channels = validate.shape((len(paths.rows), width, channels))
        self.picture_shape, self.latent_shape = (height, width, channels), (latents, width, channels)
        threads = thread_count(threads)
        self._strips = strip_blurs([paths], [1.0], self.top, latents, threads)
        self._weights = hat_weights(paths.cols, width).astype(np.float32)
        self._spectra = RowSpectra(channels, width, threads=threads)

    def forward(self, latent: ArrayLike) -> Float32Array:
        """Return the blur of a latent picture.

        Parameters
        ----------
        latent : array_like, shape (L, W, C) or, with one channel, (L, W)
            Latent picture; converted to float32.

        Returns
        -------
        ndarray, shape (H, W, C) or (H, W), float32
        """
        source = self._checked("latent", latent, self.latent_shape)
        out = np.zeros(self.picture_shape, dtype=np.float32)
        into, lanes = self._spectra.empty(len(source)), self._spectra.empty(len(out))
        with self._spectra.team.lock:
            self._spectra.load(source, into)
            for strip, weights in zip(self._strips, self._weights, strict=True):
                self._run(rowwise.forward, strip, lanes, into)
                self._spectra.unload(lanes, 0, out, Tile(0, 0, weights), add=True)
        return out.reshape(len(out), *np.shape(latent)[1:])

    def adjoint(self, picture: ArrayLike) -> Float32Array:
        """Return the transpose of :meth:`forward` applied to a recorded picture.

        Parameters
        ----------
        picture : array_like, shape (H, W, C) or, with one channel, (H, W)
            Recorded picture; converted to float32.

        Returns
        -------
        ndarray, shape (L, W, C) or (L, W), float32
        """
        source = self._checked("picture", picture, self.picture_shape)
        out = np.zeros(self.latent_shape, dtype=np.float32)
        lanes, into = self._spectra.empty(len(source)), self._spectra.empty(len(out))
        everywhere = Tile(0, 0, np.ones(source.shape[1], dtype=np.float32))
        with self._spectra.team.lock:
            for strip, weights in zip(self._strips, self._weights, strict=True):
                self._spectra.load(source * weights[:, None], lanes)
                self._run(rowwise.adjoint, strip, lanes, into)
                self._spectra.unload(into, 0, out, everywhere, add=True)
        return out.reshape(len(out), *np.shape(picture)[1:])

    def as_linear_operator(self) -> LinearOperator:
        """Return this blur as a SciPy operator on flattened pictures."""
        from scipy.sparse.linalg import LinearOperator

        return LinearOperator(
            (int(np.prod(self.picture_shape)), int(np.prod(self.latent_shape))),
            matvec=lambda x: self.forward(x.reshape(self.latent_shape)).ravel(),
            rmatvec=lambda x: self.adjoint(x.reshape(self.picture_shape)).ravel(),
            dtype=np.dtype(np.float32),
        )

    def _run(self, kernel: Callable[..., None], strip: StripBlur, lanes: Float32Array, latent: Float32Array) -> None:
        floats = strip.workspace_size(solve=False)
        workspaces = [empty((floats,), np.float32) for _ in range(self._spectra.team.threads)]

        def block(thread: int, b: int) -> None:
            kernel(strip.model, strip.table(b, self._spectra.length), lanes[b], latent[b], workspaces[thread])

        self._spectra.team.share(block, range(self._spectra.blocks))

    @staticmethod
    def _checked(name: str, picture: ArrayLike, shape: tuple[int, int, int]) -> Float32Array:
        array = validate.array(name, picture)
        if array.shape != shape and (shape[2] != 1 or array.shape != shape[:2]):
            raise InputError(f"{name} must have shape {shape}, got {array.shape}")
        validate.bounded(name, array)
        return np.ascontiguousarray(array, dtype=np.float32).reshape(shape)


def strip_blurs(
    frames: Sequence[BlurPaths], factors: Sequence[float], top: int, latents: int, threads: int | None
) -> list[StripBlur]:
    """Return :meth:`StripBlur.from_frames` of all strips; threads share them."""
    strips = range(len(frames[0].cols))
    return share_map(lambda s: StripBlur.from_frames(frames, factors, s, top, latents), strips, threads)


def latent_rows(*frames: BlurPaths) -> tuple[int, int]:
    """Return the first latent row, counted as rows of the picture, 0 or less, and the number of latent rows.

    Latent rows are those that paths of any frame visit, and those of the frame. `InputError` is raised if paths do not
    belong to the rows 0, 1, 2 and so on, or their columns do not increase.
    """
    top = end = 0
    for paths in frames:
        rows = paths.rows
        if not np.array_equal(rows, np.arange(len(rows))):
            raise InputError("paths must be those of every row of the picture; trace them with BlurPaths.every_row")
        validate.increasing("cols of the paths", paths.cols)
        visited = rows[:, None, None] - paths.displacements[..., 1]
        # The interpolating window, and a row more, into which rounding may lead a path.
        reach = (WIDTH if paths.softness else SINC_WIDTH) // 2
        top = min(top, int(np.floor(visited.min())) - reach)
        end = max(end, len(rows), int(np.floor(visited.max())) + reach + 2)
    return top, -(-(end - top) // BLOCK) * BLOCK


def _draw(
    paths: FloatArray, softness: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], Float32Array]:
    """Draw paths (H, T, 2); return the row, the displacement down and across in px, and the weight of every pixel."""
    # Rectifying puts paths far from zero, so each is drawn around the pixel nearest to its own centre.
    lowest, highest = (np.stack([end(paths[..., k], axis=1) for k in range(2)], axis=-1) for end in (np.min, np.max))
    centres = np.round((highest + lowest) / 2)
    local = np.ascontiguousarray(paths - centres[:, None])
    farthest = np.maximum(highest - centres, centres - lowest).max(axis=0)
    half_width, half_height = (int(np.ceil(reach)) + WIDTH // 2 for reach in farthest)
    size = 4 * min(len(paths), ROWS_TOGETHER) * (2 * half_height + 1) * (2 * half_width + 1)
    validate.memory(f"PSFs of {2 * half_width + 1}x{2 * half_height + 1} px", size, 0)
    taps = []
    for top in range(0, len(paths), ROWS_TOGETHER):
        kernels = interpolated(local[top : top + ROWS_TOGETHER], half_height, half_width, softness, threads=1)
        row, i, j = np.nonzero(kernels)
        across, down = centres[top + row].astype(np.intp).T
        taps.append((top + row, down + i - half_height, across + j - half_width, kernels[row, i, j]))
    row, down, across, weight = (np.concatenate(parts) for parts in zip(*taps, strict=True))
    return row, down, across, weight


def _sorted(
    row: NDArray[np.intp],
    latent: NDArray[np.intp],
    shift: NDArray[np.intp],
    weight: Float32Array,
    latents: int,
    rows: int,
) -> RowModel:
    """Return the model that holds the taps, sorted by block, latent row and picture row."""
    blocks, block = latents // BLOCK, latent // BLOCK
    first, end = np.full(blocks, rows), np.zeros(blocks, dtype=np.intp)
    np.minimum.at(first, block, row)
    np.maximum.at(end, block, row + 1)
    first[end == 0] = 0
    # The first block that each row sees, and from it the first block to which each block is coupled by the rows that it
    # shares. Gradients couple a block to the one before in any case.
    earliest = np.full(rows, blocks)
    np.minimum.at(earliest, row, block)
    before = [
        min([max(b - 1, 0), *earliest[f:e]]) for b, (f, e) in enumerate(zip(first.tolist(), end.tolist(), strict=True))
    ]
    seen = end - first
    begin = np.concatenate([[0], np.cumsum(BLOCK * seen)])
    pair = begin[block] + latent % BLOCK * seen[block] + row - first[block]
    order = np.argsort(pair, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(pair, minlength=begin[-1]))])
    index = [np.asarray(values, dtype=np.int32) for values in (first, end, before, start, shift[order])]
    return RowModel(index[0], index[1], index[2], index[3], index[4], weight[order])
