"""Non-local means: the kernel against its twin, and the laws of the denoiser."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.deconv import non_local_means as module
from rsdeblur.deconv.non_local_means import non_local_means
from rsdeblur.kernels.nlm import HALO, PATCH, WORK, average_alike
from rsdeblur.simulation.scene import scene
from tests.oracles.nlm import average_alike_numpy


@pytest.mark.parametrize("channels", [1, 3])
def test_kernel_and_twin_agree(channels: int) -> None:
    height, width = 9, 13
    planes = np.random.default_rng(0).random((channels, height + 2 * HALO, width + 2 * HALO), dtype=np.float32)
    work = np.empty((WORK, width + 2 * PATCH), np.float32)
    results = np.empty((2, channels + 1, height, width), np.float32)
    average_alike(planes, np.float32(0.02), np.float32(0.05), work, results[0])
    average_alike_numpy(planes, 0.02, 0.05, work, results[1])
    # Sums of 169 float32 weights, whose eighth powers multiply rounding errors by eight.
    np.testing.assert_allclose(results[0], results[1], rtol=1e-4)
    assert (results[0][-1] > 2).all()  # so more than the centre counts


def test_noise_falls_and_edges_stay() -> None:
    sharp = scene(96, 128)
    noisy = (sharp + np.random.default_rng(1).normal(0, 0.05, sharp.shape)).astype(np.float32)
    error = np.sqrt(np.square(non_local_means(noisy, 0.05) - sharp).mean())
    # Half of the noise's power; the scene has texture that is weaker than the noise.
    assert error < 0.05 * np.sqrt(0.5)
    np.testing.assert_array_equal(non_local_means(np.full((40, 50), 0.5, np.float32), 0.05), np.float32(0.5))


def test_blocks_and_threads_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    noisy = np.random.default_rng(2).random((70, 90, 3), dtype=np.float32)
    whole = non_local_means(noisy, 0.3, threads=1)
    monkeypatch.setattr(module, "BLOCK", (16, 33))
    np.testing.assert_array_equal(non_local_means(noisy, 0.3, threads=3), whole)
    grey = np.ascontiguousarray(noisy[..., 0])
    np.testing.assert_array_equal(non_local_means(grey, 0.3), non_local_means(grey[..., None], 0.3)[..., 0])
