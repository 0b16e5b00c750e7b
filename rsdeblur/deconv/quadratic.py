"""What priors on the gradient come down to, solved tile by tile in the hybrid domain."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.deconv.border import Border
from rsdeblur.deconv.fft import Planning
from rsdeblur.deconv.wiener import TileFilter
from rsdeblur.kernels.responses import responses
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage

# What a tile is longer than its part, in PSFs.
MARGIN = 3.0


class TileQuadratic(TileFilter):
    """The quadratic problem for a bank of PSFs, solved by two passes of filters.

        U = ((1 + nsr) conj(H) G + beta V) / (|H|^2 + nsr + beta |D|^2)

    V is the pull. The factor 1 + nsr does what it does in :class:`rsdeblur.Deconvolver`. It is a
    :class:`rsdeblur.deconv.priors.QuadraticSolver`.

    Parameters
    ----------
    bank, border, planning, threads
        See :class:`rsdeblur.Deconvolver`.
    shape : (H, W, C)
        Shape of the pictures to come.
    nsr : float, default 0.001
        Share of the signal's power that the model gets wrong, such as at the borders; not negative.

    Raises
    ------
    InputError
        As :class:`rsdeblur.Deconvolver` does.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, int, int],
        *,
        nsr: float = 0.001,
        border: Border = "blend",
        planning: Planning = "estimate",
        threads: int | None = None,
    ) -> None:
        super().__init__(bank, shape, margin=MARGIN, border=border, planning=planning, threads=threads)
        self.nsr = validate.finite("nsr", nsr, minimum=0.0)
        self.periodic = border == "periodic"
        self._otf, self._filters = self._new_filters(), self._new_filters()
        self.replan(bank)
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / length) ** 2).astype(np.float32)
            for count, length in (
                (self._hybrid.frequencies, self._strips.length),
                (self._bands.length, self._bands.length),
            )
        )

    def _take(self, bank: PsfBank) -> None:
        self._fill_otfs(bank, self._otf)

    def prepare(self, image: ArrayLike) -> None:
        """Take the observation, of the planned shape, linear light."""
        self._observation = np.ascontiguousarray(image, dtype=np.float32)

    def solve(self, beta: float, grad_adjoint: FloatImage | None = None) -> FloatImage:
        """Return the minimiser for the observation; `grad_adjoint` is `D^T w`, None is zero, and is used up.

        Raises
        ------
        InputError
            If the observation has another shape than planned or is not finite.
        """
        observed = self._respond(beta, self._observation, None, of_grad_adjoint=False)
        if grad_adjoint is None:
            return observed
        found = self._respond(beta, grad_adjoint, grad_adjoint, of_grad_adjoint=True)
        found += observed
        return found

    def _respond(
        self, beta: float, picture: FloatImage, out: FloatImage | None, *, of_grad_adjoint: bool
    ) -> FloatImage:
        def plan(_: int, s: int, b: int) -> None:
            inside = np.s_[s, b, : self._hybrid.frequencies]
            responses(
                self._otf[inside],
                self._across,
                self._down,
                np.float32(self.nsr),
                np.float32(beta),
                np.float32(self._scale),
                of_grad_adjoint,
                self._filters[inside],
            )

        self._share_tiles(plan)
        return self._apply(self._filters, picture, out, None)
