"""What a frame shows of a sharp picture, computed only where that is needed."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, hand_shake
from rsdeblur.burst.solution import predicted
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.motion import Capture
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.simulation.scene import scene

# Two blocks, of which one shows no spot.
SHAPE = 200, 1200


@pytest.fixture(scope="module")
def bank() -> PsfBank:
    camera = Camera(1200, 200, 1300.0, readout_time=0.02)
    capture = Capture.from_log(hand_shake(0.5, seed=4), camera, Exposure(0.1, 0.02))
    return PsfBank.from_paths(BlurPaths.from_capture(capture, tile_centres(4, 200), tile_centres(3, 1200)))


def mask(kind: str) -> np.ndarray:
    wanted = np.zeros(SHAPE, dtype=bool)
    if kind == "margins":
        wanted[:20] = wanted[:, -5:] = True
    elif kind == "spots":
        wanted[[10, 150, 199], [399, 200, 0]] = True
    elif kind == "all":
        wanted[...] = True
    return wanted


@pytest.mark.parametrize("kind", ["none", "margins", "spots", "all"])
def test_parts_show_what_the_whole_does(bank: PsfBank, kind: str) -> None:
    latent, wanted = scene(*SHAPE), mask(kind)
    whole = TileBlur(bank, latent.shape).forward(latent)
    got = np.full_like(whole, np.nan)
    for part, blurred in predicted(latent, wanted, bank, threads=1):
        assert np.isnan(got[part]).all()
        got[part] = blurred
    assert np.isfinite(got[wanted]).all()
    assert np.isnan(got).any() == (kind in ("none", "spots"))
    tall, wide = bank.size
    # Beyond the frame both continue the picture, but fade it into different opposite borders.
    inner = np.zeros(SHAPE, dtype=bool)
    inner[tall:-tall, wide:-wide] = True
    # Tiles end elsewhere; measured 0.0021 at most.
    np.testing.assert_allclose(got[wanted & inner], whole[wanted & inner], atol=4e-3)
    for part, blurred in predicted(latent, wanted, bank, threads=3):
        np.testing.assert_array_equal(blurred, got[part])
