"""The choice of a burst's reference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rsdeblur.burst import alignment as burst_alignment
from rsdeblur.burst.alignment import AlignedBurst, aligned
from rsdeblur.pipeline.stages import StageClock


@pytest.mark.parametrize(
    ("errors", "supports", "chosen"),
    [
        # The sharpest frame, if most others fit it.
        ((1.0, 0.9, 3.0), ((None, 1, 1), (1, None, 1), (1, 1, None)), 1),
        # One that shows something else is no better than two that agree.
        ((0.9, 1.0, 1.0), ((None, 0, 0), (0, None, 0.9), (0, 0.9, None)), 1),
        # A much sharper one is, whether their motion is wrong or its own scene is nearer.
        ((0.1, 1.0, 1.0), ((None, 0.3, 0.3), (0.3, None, 0.9), (0.3, 0.9, None)), 0),
        # Two that agree: the sharper one, though the other one fits most frames.
        ((0.1, 0.2, 1.0, 1.0), ((None, 0.9, 0.3, 0.3), (0.9, None, 0.6, 0.6), (0,) * 4, (0,) * 4), 0),
    ],
)
def test_the_data_that_fit_decide(
    errors: tuple[float, ...], supports: tuple[tuple[float | None, ...], ...], chosen: int, monkeypatch: Any
) -> None:
    def fitted(index: int, *_: object) -> AlignedBurst:
        fits = [None if support is None else SimpleNamespace(support=support) for support in supports[index]]
        frames: Any = tuple(SimpleNamespace(fit=fit) for fit in fits)
        return AlignedBurst(index, frames)

    monkeypatch.setattr(burst_alignment, "_fitted", fitted)
    monkeypatch.setattr(burst_alignment, "restoration_error", lambda tuning, _: tuning.error)
    tunings: Any = [SimpleNamespace(energy=1.0, error=error) for error in errors]
    splits: Any = [SimpleNamespace(remainder=lambda *_: np.arange(2.0))] * len(errors)
    assert aligned(splits, splits, tunings, "auto", StageClock(None), None).index == chosen
    assert aligned(splits, splits, tunings, 2, StageClock(None), None).index == 2
