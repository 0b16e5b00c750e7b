"""Several blurred pictures of one scene, solved together: their normal equations add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.choices import Border
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.deconv.quadratic import TileNormal
from rsdeblur.deconv.rowwise import RowSolver
from rsdeblur.deconv.wiener import LEAST_MARGIN, LEAST_NSR, decay_margin
from rsdeblur.errors import InputError
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage


class BurstQuadratic(TileNormal):
    """Deconvolution of several pictures of one scene, planned once and applied often.

    As a :class:`rsdeblur.deconv.priors.QuadraticSolver` it solves, for the frames i,

        U = ((1 + nsr) sum_i a_i conj(H_i) G_i + beta V) / (sum_i a_i |H_i|^2 + nsr + beta |D|^2)

    The share a_i of a frame is the inverse of its noise power, divided by the sum of these over all frames. With one
    frame this is :class:`rsdeblur.deconv.TileQuadratic`, or :class:`rsdeblur.Deconvolver` if `wiener` says that
    pictures are solved without a prior. Both sums are computed once and kept, frame by frame, so memory and the time of
    a solve do not grow with the number of frames.
    """

    def __init__(
        self,
        banks: Sequence[PsfBank],
        shares: Sequence[float],
        shape: tuple[int, ...],
        *,
        nsr: float = 0.001,
        wiener: bool = False,
        border: Border = "blend",
        threads: int | None = None,
    ) -> None:
        for bank in banks:
            validate.instance("bank", bank, PsfBank)
        _check_places(banks, shares)
        nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        margin = LEAST_MARGIN
        if wiener:
            nsr = max(nsr, LEAST_NSR)
            margin = decay_margin(nsr)
        tall, wide = np.max([bank.size for bank in banks], axis=0)
        self._banks = [bank.padded((int(tall), int(wide))) for bank in banks]
        super().__init__(
            *(self._banks[0], shape),
            nsr=nsr,
            margin=margin,
            border=border,
            threads=threads,
        )
        self.shares = tuple(map(float, shares))

    def apply(
        self,
        images: Iterable[ArrayLike],
        *,
        prior: LatentPrior | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Return the sharp picture, of the planned shape and not clipped, from the linear light of each frame.

        A frame is needed only until the next one comes. Without a prior the result is that of the Wiener filter. Errors
        are those of :meth:`rsdeblur.Deconvolver.apply`, and another number of pictures than planned.
        """
        validate.callback("progress", progress)
        with self._hybrid.team.turn():
            prior = self._observe(images, prior)
            latent = self.solve(0.0) if prior is None else prior.restore(self, threads=self.threads, progress=progress)
            # The sums take more memory than all else.
            self._sums = None
        return latent.reshape(self.shape)

    def _observe(self, images: Iterable[ArrayLike], prior: LatentPrior | None) -> LatentPrior | None:
        """Sum up the normal equations of all frames; return the prior with the brightness of the first one."""
        self._sums, sums = None, self._new_sums()
        for frame, picture in enumerate(_checked(images, len(self.shares), self.shape)):
            if frame == 0 and prior is not None:
                prior = check_prior(prior).with_peak_of(picture)
            self._add(sums, self._banks[frame], picture, self.shares[frame], first=frame == 0)
        self._sums = sums
        return prior


class RowBurst(RowSolver):
    """Deconvolution of several pictures of one scene with the PSF of every row, planned once and applied often.

    With one frame this is :class:`rsdeblur.deconv.RowDeconvolver`, whose arguments and errors it has. The normal matrix
    is assembled from all frames, whose paths are in the same strips, but factored once: its bandwidth is that of the
    frame whose paths are tallest. `shares` are those of :class:`BurstQuadratic`.
    """

    def __init__(
        self, frames: Sequence[BlurPaths], shares: Sequence[float], shape: tuple[int, ...], **engine: Any
    ) -> None:
        _check_places(frames, shares)
        super().__init__(frames, shares, shape, **engine)

    def apply(
        self,
        images: Iterable[ArrayLike],
        *,
        prior: LatentPrior | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur the pictures of one scene; see :meth:`BurstQuadratic.apply`."""
        validate.callback("progress", progress)
        frames, (height, width, *channelled) = len(self._factors), self.shape
        channels = channelled[0] if channelled else 1
        rows = np.empty((height, frames, width, channels), dtype=np.float32)
        for i, picture in enumerate(_checked(images, frames, self.shape)):
            if i == 0 and prior is not None:
                prior = check_prior(prior).with_peak_of(picture)
            np.multiply(picture, np.float32(self._factors[i]), out=rows[:, i])
        out = np.empty((height, width, channels), dtype=np.float32)
        self._restore(rows.reshape(-1, width, channels), out, prior, progress)
        return out.reshape(self.shape)


def _checked(images: Iterable[ArrayLike], count: int, shape: tuple[int, ...]) -> Iterator[FloatImage]:
    """Yield `count` pictures of the planned shape as (H, W, C)."""
    pictures = 0
    for image in images:
        pictures += 1
        if pictures <= count:
            yield validate.linear_light(image, shape).reshape(*shape[:2], -1)
    if pictures != count:
        raise InputError(f"the solver is planned for {count} pictures, got {pictures}")


def _check_places(blurs: Sequence[PsfBank] | Sequence[BlurPaths], shares: Sequence[float]) -> None:
    """Raise `InputError` unless the blurs of all frames have the same places, and the shares suit them."""
    if not blurs or len(blurs) != len(shares):
        raise InputError(f"a burst needs PSFs and a share for each frame, got {len(blurs)} and {len(shares)}")
    for blur in blurs:
        if not (np.array_equal(blur.rows, blurs[0].rows) and np.array_equal(blur.cols, blurs[0].cols)):
            raise InputError("the PSFs of all frames of a burst must have the same places")
    if min(shares) <= 0 or abs(sum(shares) - 1) > 1e-6:  # rounding
        raise InputError(f"shares of frames must be positive and sum to 1, got {', '.join(map(str, shares))}")
