"""Matches of all pairs of neighbouring frames of a clip."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.estimate.registration import Matches, ReducedFrame, match
from rsdeblur.image.encoded import EncodedImage, check_size
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.types import FloatArray, Progress

# Frames further apart than this are not matched, s.
LONGEST_STEP = 0.6
# Least number of matches in a pair of frames.
LEAST_MATCHES = 12


@dataclass(frozen=True, slots=True, eq=False)
class ClipMatches:
    """Matches of all pairs of neighbouring frames of a clip.

    Parameters
    ----------
    points, moved : ndarray, shape (n, 2)
        (x, y) in px in the first and in the second frame of the pair.
    pair : ndarray, shape (n,)
        Number of the pair, not decreasing.
    opens : ndarray, shape (pairs, 2)
        Start of exposure of the row in the middle of both frames for a global shutter, s, camera time without offset.
    durations : ndarray, shape (pairs, 2)
        Exposure times of a row, s.
    """

    points: FloatArray
    moved: FloatArray
    pair: NDArray[np.intp]
    opens: FloatArray
    durations: FloatArray

    @classmethod
    def of(cls, matches: list[Matches], opens: FloatArray, durations: FloatArray) -> ClipMatches:
        """Join the matches of all pairs."""
        pair = np.repeat(np.arange(len(matches)), [len(each.points) for each in matches])
        # The empty array makes the shape right where there are no pairs.
        points, moved = (
            np.concatenate([np.empty((0, 2)), *(getattr(each, name) for each in matches)]) for name in Matches._fields
        )
        return cls(points, moved, pair, opens, durations)

    def selected(self, keep: NDArray[np.bool_]) -> ClipMatches:
        """Return the matches where `keep`, shape (n,), is set, with the same numbers of the pairs."""
        return ClipMatches(self.points[keep], self.moved[keep], self.pair[keep], self.opens, self.durations)

    @property
    def starts(self) -> NDArray[np.intp]:
        """Indices of the first match of each pair, and the number of matches; shape (pairs + 1,)."""
        return np.searchsorted(self.pair, np.arange(len(self.opens) + 1))

    @property
    def flow(self) -> FloatArray:
        """Motion of the points, px, shape (n, 2)."""
        return self.moved - self.points


def match_clip(
    frames: Iterable[ArrayLike], exposures: Sequence[Exposure], camera: Camera, progress: Progress | None = None
) -> ClipMatches:
    """Return the matches of all neighbouring frames; times are relative to the first exposure's epoch.

    Parameters
    ----------
    frames, exposures, camera, progress
        See :func:`calibrate`.

    Raises
    ------
    InputError
        See :func:`calibrate`.
    """
    share = TIMESTAMP_SHARES[camera.timestamp_marks]
    found: list[Matches] = []
    opens: list[tuple[float, float]] = []
    durations: list[tuple[float, float]] = []
    before: tuple[ReducedFrame, Exposure] | None = None
    count = 0
    for image in validate.items("frames", frames):
        if count == len(exposures):
            raise InputError(f"there must be one exposure for each frame, got more than {count} frames")
        now = ReducedFrame(_grey(image, camera)), exposures[count]
        if before is not None:
            start, end = (
                1e-9 * (each.epoch_ns - exposures[0].epoch_ns) + each.start - share * each.duration
                for each in (before[1], now[1])
            )
            if end <= start:
                raise InputError(
                    f"the exposures must be in the order of time: frame {count} is not after the one before"
                )
            pair = _within_lens(match(before[0], now[0]), camera) if end - start < LONGEST_STEP else None
            if pair is not None and len(pair.points) >= LEAST_MATCHES:
                found.append(pair)
                opens.append((start, end))
                durations.append((before[1].duration, now[1].duration))
        before = now
        count += 1
        if progress:
            progress("match", count / len(exposures))
    if count < len(exposures):
        raise InputError(
            f"there must be one exposure for each frame, got {count} frames and {len(exposures)} exposures"
        )
    return ClipMatches.of(found, np.reshape(opens, (-1, 2)), np.reshape(durations, (-1, 2)))


def _within_lens(matches: Matches, camera: Camera) -> Matches:
    """Return the matches that the lens model describes, in front of the camera."""
    points, moved = matches
    rays = np.stack([camera.rays(points), camera.rays(moved)])
    # NaN where there is no direction
    good = (np.isfinite(rays).all(axis=2) & (rays[..., 2] > 0)).all(axis=0)
    return Matches(points[good], moved[good])


def _grey(image: ArrayLike, camera: Camera) -> NDArray[np.float32]:
    """Return the brightness of a frame as its values encode it; shadows have more contrast there than in light."""
    encoded = EncodedImage.of(image)
    check_size(encoded.shape, camera)
    grey: NDArray[np.float32] = encoded.values[..., : encoded.shape[2]].mean(axis=2, dtype=np.float32)
    if not np.isfinite(grey).all():
        raise InputError("a frame must be finite")
    return grey
