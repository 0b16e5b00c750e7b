"""The exact rolling-shutter deconvolution of one picture, by the solver of :mod:`rsdeblur.deconv.rowwise_solver`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.deconv.rowwise_solver import RowSolver
from rsdeblur.motion.paths import BlurPaths


@one_line("shape", "nsr")
class RowDeconvolver(RowSolver):
    """Deconvolution with the PSF of every row, planned once and applied often.

    Minimises `|A u - g|^2 + nsr |u - m|^2` exactly. A is :class:`rsdeblur.deconv.RowBlur`; m is the picture's mean and,
    near top and bottom, the smoothed average of its outermost rows. The difference u - m is then multiplied by
    (1 + nsr). With this factor no motion is the identity, and a constant picture keeps its brightness.

    Parameters
    ----------
    paths : BlurPaths
        Paths of every row of the picture (:meth:`rsdeblur.motion.BlurPaths.every_row`), in one or more strips.
    shape : (H, W) or (H, W, C)
        Shape of the pictures.
    nsr : float, default 0.01
        Noise-to-signal power ratio Phi, from 1e-20 to 1e20; less than 1e-6, the limit of float32, counts as 1e-6.
    reach : int, default 0
        Least reach of the paths along x, px, for which the continuation of the picture is planned: where the rows are a
        part of a picture, that of its longest path, so that all parts are continued alike.
    border : {"blend", "periodic"}
        How the picture continues along x, see :class:`rsdeblur.Deconvolver`. Along y, rows beyond the frame are
        unknowns.
    planning : {"estimate", "measure"}
        How FFTW plans, see :class:`rsdeblur.Deconvolver`.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Attributes
    ----------
    top : int
        Row of the picture at which the first latent row lies; 0 or less.

    Raises
    ------
    InputError
        If `paths` are not those of the picture's rows or reach further than the picture, or an argument is out of
        range.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 48, 80.0)
    >>> capture = rsdeblur.motion.Capture.from_log(log, camera, rsdeblur.Exposure(0.2, 0.05))
    >>> paths = rsdeblur.motion.BlurPaths.every_row(capture, cols=[31.5])
    >>> rsdeblur.deconv.RowDeconvolver(paths, (48, 64)).apply(np.full((48, 64), 0.5)).shape
    (48, 64)
    """

    def __init__(
        self,
        paths: BlurPaths,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.01,
        reach: int = 0,
        border: Border = "blend",
        planning: Planning = "estimate",
        threads: int | None = None,
    ) -> None:
        validate.instance("paths", paths, BlurPaths)
        reach = validate.count("reach", reach, minimum=0)
        super().__init__(
            *([paths], [1.0], shape),
            nsr=nsr,
            reach=reach,
            border=border,
            planning=planning,
            threads=threads,
        )

    def apply(
        self,
        image: ArrayLike,
        out: NDArray[np.float32] | None = None,
        *,
        prior: LatentPrior | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur one picture.

        Parameters
        ----------
        image : array_like of the planned shape
            Linear light, floats; converted to float32.
        out : ndarray, float32, optional
            Receives the result; may be `image` itself.
        prior : DerivativePrior, WaveletPrior or PlugAndPlayPrior, optional
            Assumption about the sharp picture; without it the result is that of the Wiener filter.
        progress : callable, optional
            Called with the finished fraction after each strip and, with a prior, after each solve.

        Returns
        -------
        ndarray, float32
            `out`, or a new array; not clipped.

        Raises
        ------
        InputError
            If `image` or `out` has another shape or type, or `image` is not finite. Integers are no linear light:
            :func:`rsdeblur.image.transfer.to_linear` converts them.
        """
        if prior is not None:
            check_prior(prior)
        validate.callback("progress", progress)
        picture = validate.linear_light(image, self.shape)
        out = validate.output(out, self.shape)
        source, target = (array.reshape(*array.shape[:2], -1) for array in (picture, out))
        prior = None if prior is None else prior.with_peak_of(picture)
        # Strips are added up in `out`, so it cannot be the source as well.
        if len(self._strips) > 1 and np.shares_memory(source, target):
            source = source.copy()
        self._restore(source, target, prior, progress)
        return out
