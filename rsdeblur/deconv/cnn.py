"""A learned denoiser: a small convolutional network that ONNX Runtime evaluates, in blocks that threads share.

As in FFDNet [1]_, the network sees a plane as four quarters of half the resolution, and the noise as one more plane. It
has no additive constants [2]_, so light that is twice as bright, with twice the noise, gives a result that is twice as
bright. ``python -m benchmarks.train_cnn`` learns such a network.

.. [1] K. Zhang, W. Zuo and L. Zhang, "FFDNet: toward a fast and flexible solution for CNN-based image denoising", IEEE
   Trans. Image Processing 27, 2018.
.. [2] S. Mohan, Z. Kadkhodaie, E. Simoncelli and C. Fernandez-Granda, "Robust and interpretable blind image denoising
   via bias-free convolutional neural networks", ICLR 2020.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rsdeblur._util.threads import share_blocks
from rsdeblur._util.validate import missing
from rsdeblur.errors import InputError
from rsdeblur.types import FloatImage

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

NETWORK = Path(__file__).with_name("cnn.onnx")
# Pixels around a block that its result depends on: ten convolutions reach ten pixels of half the resolution.
HALO = 20
# Height and width of the blocks that a thread works on, px; even, so that all blocks have the same quarters.
BLOCK = 256, 256
# Brightness and two colour differences, an orthonormal basis.
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3.0], [2.0], [6.0]])


def cnn_denoise(image: FloatImage, sigma: float, *, threads: int | None = None) -> FloatImage:
    """Return linear light, (H, W) or (H, W, C), without white noise of the standard deviation `sigma`.

    The picture is mirrored at its borders. Three channels are denoised as brightness and two differences of colour.
    Without ONNX Runtime this raises `InputError`.
    """
    session = network()
    deep = image.reshape(*image.shape[:2], -1)
    height, width, channels = deep.shape
    mix = (OPPONENT if channels == 3 else np.eye(channels)).astype(np.float32)
    # One more row and column, so that every block has even sides.
    padded = np.pad(deep, [(HALO, HALO + 1), (HALO, HALO + 1), (0, 0)], mode="symmetric")
    level = np.full((channels, 1, 1, 1), sigma, dtype=np.float32)

    def run(planes: FloatImage) -> FloatImage:
        inner: FloatImage = session.run(None, {"plane": planes, "sigma": level})[0][:, 0, HALO:-HALO, HALO:-HALO]
        return inner

    # What the network changes in an even picture of the same mean, in each quarter; so even pictures stay as they are.
    mean = (deep.mean(axis=(0, 1), dtype=np.float64) @ mix.T).astype(np.float32)[:, None, None]
    change = run(np.broadcast_to(mean[:, None], (channels, 1, 2 * HALO + 2, 2 * HALO + 2)).copy()) - mean
    result = np.empty_like(deep, dtype=np.float32)

    def block(_: int, *place: slice) -> None:
        around = padded[*(slice(one.start, one.stop + one.stop % 2 + 2 * HALO) for one in place)] @ mix.T
        denoised = run(np.ascontiguousarray(around.transpose(2, 0, 1)[:, None], dtype=np.float32))
        denoised -= np.tile(change, (1, denoised.shape[1] // 2, denoised.shape[2] // 2))
        tall, wide, _ = result[place].shape
        result[place] = denoised[:, :tall, :wide].transpose(1, 2, 0) @ mix

    share_blocks(block, (height, width), BLOCK, threads)
    return result.reshape(image.shape)


@cache
def network() -> InferenceSession:
    """Return the network; raise `InputError` if ONNX Runtime is not installed."""
    try:
        import onnxruntime
    except ImportError:
        raise InputError(missing('prior="cnn" needs ONNX Runtime', "cnn")) from None
    onnxruntime.disable_telemetry_events()  # official builds for Windows report their use
    options = onnxruntime.SessionOptions()
    # Blocks are shared by our threads. More threads within a block would wait for each other.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(NETWORK, options, providers=["CPUExecutionProvider"])
