"""The interface of solvers with priors: one picture of a scene, or several frames whose normal equations add up."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.threads import ThreadTeam
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.types import FloatImage


class SceneSolver:
    """Base of the solvers with priors, which are planned for pictures of one `shape`."""

    shape: tuple[int, ...]
    _team: ThreadTeam

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
        prior : DerivativePrior or PlugAndPlayPrior, optional
            Assumption about the sharp picture, which :class:`TileQuadratic` needs. Without it the result of
            :class:`RowDeconvolver` is that of the Wiener filter.
        progress : callable, optional
            Called with the finished fraction after each solve and, without a prior, after each strip.

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
        if out is not None:
            validate.output(out, self.shape)
        restored = self.combine([image], prior=prior, progress=progress)
        if out is None:
            return restored
        out[...] = restored
        return out

    def combine(
        self,
        images: Iterable[ArrayLike],
        *,
        prior: LatentPrior | None,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur the frames of one scene together, see :meth:`apply`; each is needed only until the next one comes."""
        validate.callback("progress", progress)
        if prior is not None:
            check_prior(prior)
        with self._team.turn():
            for frame, image in enumerate(images):
                picture = validate.linear_light(image, self.shape).reshape(*self.shape[:2], -1)
                if frame == 0 and prior is not None:
                    prior = prior.with_peak_of(picture)
                self.observe(frame, picture)
            return self._restored(prior, progress).reshape(self.shape)

    def observe(self, frame: int, picture: FloatImage) -> None:
        """Take in a frame (H, W, C), counted from 0."""
        raise NotImplementedError

    def _restored(self, prior: LatentPrior | None, progress: Callable[[float], None] | None) -> FloatImage:
        """Return the sharp picture (H, W, C) of all frames."""
        raise NotImplementedError
