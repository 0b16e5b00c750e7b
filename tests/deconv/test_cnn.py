"""Laws of the learned denoiser."""

import sys

import numpy as np
import pytest

from rsdeblur import InputError, scene
from rsdeblur.deconv import cnn
from rsdeblur.deconv.cnn import BLOCK, cnn_denoise
from tests.installed import needs

needs("cnn")
SIGMA = 0.05


def noisy(height: int, width: int, channels: int = 3) -> tuple[np.ndarray, np.ndarray]:
    sharp = scene(height, width)[..., :channels]
    noise = np.random.default_rng(4).normal(0, SIGMA, sharp.shape)
    return sharp, (sharp + noise).astype(np.float32)


def test_most_of_the_noise_is_removed() -> None:
    sharp, image = noisy(96, 128)
    before, after = (np.square(each - sharp).mean() for each in (image, cnn_denoise(image, SIGMA)))
    # Measured 0.38; much of the scene is detail of a single pixel.
    assert after < 0.45 * before


def test_light_scales() -> None:
    """The network has no additive constants."""
    _, image = noisy(64, 70)
    # 1e-5 of the noise: rounding of ten layers.
    np.testing.assert_allclose(
        cnn_denoise(image * np.float32(3), 3 * SIGMA), 3 * cnn_denoise(image, SIGMA), atol=1e-5 * SIGMA * 3
    )


@pytest.mark.parametrize("level", [0.0, 0.3, 40.0])
def test_even_pictures_stay_as_they_are(level: float) -> None:
    image = np.zeros((65, 70, 3), dtype=np.float32) + level * np.array([1.0, 0.5, 0.8], dtype=np.float32)
    # Rounding of ten layers, and of the mix of colours.
    np.testing.assert_allclose(cnn_denoise(image, SIGMA), image, atol=1e-5 * max(level, SIGMA))


@pytest.mark.parametrize("shape", [(1, 1), (7, 300, 1), (BLOCK[0] + 1, 3, 3), (33, 34, 4)])
def test_any_shape_and_number_of_threads(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).random(shape, dtype=np.float32)
    one, three = (cnn_denoise(image, SIGMA, threads=threads) for threads in (1, 3))
    assert one.shape == shape
    assert one.dtype == np.float32
    np.testing.assert_array_equal(one, three)


def test_without_onnx_runtime_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    cnn.network.cache_clear()
    with pytest.raises(InputError, match=r"pip install '\.\[cnn\]'"):
        cnn_denoise(np.zeros((4, 4), np.float32), SIGMA)
