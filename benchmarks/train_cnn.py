"""Learn the denoiser of the prior "cnn": ``python -m benchmarks.train_cnn``; writes rsdeblur/deconv/cnn.onnx.

Needs the extra `train` (PyTorch), and about an hour on two cores. The network learns to remove white noise of all
levels from crops of sharp pictures: two of the folder `sharp` beside the recordings, and those that scikit-image and
scikit-learn contain. The benchmarks use none of them.

Everything is seeded, but sums of threads differ in their last bits, and so does the network after many steps.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import skimage.data
import sklearn.datasets
import torch
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from PIL import Image as Pillow
from rich.progress import track

from benchmarks.data import DATA, Image, require_data
from rsdeblur import to_linear
from rsdeblur.deconv.cnn import NETWORK, OPPONENT

# Layers, and planes between them.
LAYERS, PLANES = 10, 48
# Steps, and the share of them that multiplies in 16 bits, which takes half the time.
STEPS, SHORT = 40000, 0.85
# The learning rate, which falls to 0 by a cosine, and the steps over which it rises; the limit of the gradient's norm;
# the share of each step in the average of the factors, which is what is kept.
RATE, RISE, CLIP, AVERAGE = 7e-4, 200, 0.5, 0.003
# Noise in units of 255, crops per step and their side, px.
NOISES, CROPS, CROP = (0.5, 60.0), 24, 96
# Shares of light (the others are encoded values), of single channels, and of brightness (the rest are differences of
# colour).
LINEAR, CHANNELS, BRIGHTNESS = 0.4, 0.2, 0.55


def pictures() -> list[Image]:
    """Return the sharp pictures, values in [0, 1], reduced by whole factors until they are sharp at each pixel."""
    bundled = Path(skimage.data.__file__).parent
    sources = {
        DATA / "sharp" / "imagecompression_flower_foveon_rgb8.png": (1, 2, 3),
        DATA / "sharp" / "opensfm_berlin_01.jpg": (2, 3, 4),
        **{bundled / name: (1,) for name in ("astronaut.png", "chelsea.png", "coffee.png", "rocket.jpg")},
        bundled / "motorcycle_left.png": (1, 2),
    }
    return reduced(sources)


def reduced(sources: Mapping[Path, tuple[int, ...]]) -> list[Image]:
    """Return pictures reduced by each of their factors, values in [0, 1]."""
    found = []
    for path, factors in sources.items():
        with Pillow.open(path) as stored:
            for factor in factors:
                size = stored.width // factor, stored.height // factor
                smaller = stored.convert("RGB").resize(size, Pillow.Resampling.LANCZOS)
                found.append(np.asarray(smaller, dtype=np.float32) / np.float32(255))
    return found


def planes() -> tuple[list[Image], NDArray[np.float64]]:
    """Return planes of the sharp pictures, and the share of the crops that each gives: by the root of its size."""
    textures, photos = Path(skimage.data.__file__).parent, Path(sklearn.datasets.__file__).parent / "images"
    more = {textures / f"{name}.png": (1,) for name in ("brick", "grass", "gravel", "page", "coins")}
    found, shares = [], []
    for picture in pictures() + reduced(more | {photos / f"{name}.jpg": (1, 2) for name in ("china", "flower")}):
        size = picture[..., 0].size ** 0.5 * (min(picture.shape[:2]) >= CROP)
        for values, share in ((picture, 1 - LINEAR), (to_linear(picture, "srgb"), LINEAR)):
            mixed = values @ OPPONENT.T.astype(np.float32)
            found += [*np.moveaxis(values, -1, 0), mixed[..., 0] / np.float32(3**0.5), mixed[..., 1], mixed[..., 2]]
            others = (1 - CHANNELS - BRIGHTNESS) / 2
            shares += [size * share * each for each in (*[CHANNELS / 3] * 3, BRIGHTNESS, others, others)]
    return [np.ascontiguousarray(each, dtype=np.float32) for each in found], np.array(shares) / sum(shares)


def crops(rng: np.random.Generator, sources: list[Image], shares: NDArray[np.float64]) -> Any:
    """Return crops of random planes, turned at random."""
    batch = np.empty((CROPS, CROP, CROP), dtype=np.float32)
    for out, n in zip(batch, rng.choice(len(sources), CROPS, p=shares), strict=True):
        top, left = (rng.integers(side - CROP + 1) for side in sources[n].shape)
        turned = np.rot90(sources[n][top : top + CROP, left : left + CROP], int(rng.integers(4)))
        out[:] = turned[::-1] if rng.random() < 0.5 else turned
    return torch.from_numpy(batch)


def untrained() -> Any:
    """Return the layers with random factors."""
    widths = [5, *[PLANES] * (LAYERS - 1), 4]
    layers = []
    for n, (before, after) in enumerate(pairwise(widths)):
        layer = torch.nn.Conv2d(before, after, 3, padding=1, bias=False)
        torch.nn.init.kaiming_normal_(layer.weight)
        layers.append(layer)
        if n < LAYERS - 1:
            layers.append(torch.nn.ReLU())
    layers[-1].weight.data *= 0.1
    return torch.nn.Sequential(*layers)


def noise_in(layers: Any, noisy: Any, sigmas: Any) -> Any:
    """Return what the network takes for noise in planes (N, H, W) with noise of the standard deviations `sigmas`."""
    quarters = torch.nn.functional.pixel_unshuffle(noisy[:, None], 2)
    level = sigmas.view(-1, 1, 1, 1).expand(-1, 1, *quarters.shape[2:])
    return torch.nn.functional.pixel_shuffle(layers(torch.cat([quarters, level], 1)), 2)[:, 0]


def learn(layers: Any, rng: np.random.Generator, steps: int) -> None:
    """Learn by the mean logarithm of the squared error, so that all levels of noise count alike."""
    sources, shares = planes()
    optimizer = torch.optim.Adam(layers.parameters())
    mean = [each.detach().clone() for each in layers.parameters()]
    least, most = NOISES
    for n in track(range(steps), "learning"):
        for group in optimizer.param_groups:
            group["lr"] = RATE * 0.5 * (1 + math.cos(math.pi * n / steps)) * min(1.0, (n + 1) / RISE)
        sharp = crops(rng, sources, shares)
        sigmas = torch.from_numpy((least * (most / least) ** rng.random(CROPS) / 255).astype(np.float32))
        noise = sigmas[:, None, None] * torch.randn_like(sharp)
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=n < SHORT * steps):
            found = noise_in(layers, sharp + noise, sigmas)
        squares = (found.float() - noise).square().mean((1, 2))
        optimizer.zero_grad()
        torch.log(squares / sigmas**2).mean().backward()
        torch.nn.utils.clip_grad_norm_(layers.parameters(), CLIP)
        optimizer.step()
        for each, now in zip(mean, layers.parameters(), strict=True):
            each.lerp_(now.detach(), AVERAGE)
    for each, now in zip(mean, layers.parameters(), strict=True):
        now.data.copy_(each)


def save(layers: Any, path: Path) -> None:
    """Write the network for ONNX Runtime."""
    factors = [each.detach().numpy() for each in layers.parameters()]
    constants = {"zero": np.array([0]), "one": np.array([1]), "channel": np.array([1]), "nothing": np.zeros((1,) * 4)}
    constants["nothing"] = constants["nothing"].astype(np.float32)
    nodes = [
        helper.make_node("SpaceToDepth", ["plane"], ["quarters"], blocksize=2),
        # The level of the noise, in the shape of a quarter.
        helper.make_node("Slice", ["quarters", "zero", "one", "channel"], ["quarter"]),
        helper.make_node("Mul", ["quarter", "nothing"], ["blank"]),
        helper.make_node("Add", ["blank", "sigma"], ["level"]),
        helper.make_node("Concat", ["quarters", "level"], ["planes0"], axis=1),
    ]
    for n, factor in enumerate(factors):
        constants[f"factors{n}"] = factor
        nodes.append(
            helper.make_node("Conv", [f"planes{n}", f"factors{n}"], [f"sums{n}"], kernel_shape=[3, 3], pads=[1] * 4)
        )
        if n < LAYERS - 1:
            nodes.append(helper.make_node("Relu", [f"sums{n}"], [f"planes{n + 1}"]))
    nodes.append(helper.make_node("DepthToSpace", [f"sums{LAYERS - 1}"], ["noise"], blocksize=2))
    nodes.append(helper.make_node("Sub", ["plane", "noise"], ["denoised"]))
    kind = onnx.TensorProto.FLOAT
    shapes: dict[str, list[Any]] = {"plane": ["n", 1, "h", "w"], "sigma": ["n", 1, 1, 1]}
    inputs = [helper.make_tensor_value_info(name, kind, shape) for name, shape in shapes.items()]
    outputs = [helper.make_tensor_value_info("denoised", kind, shapes["plane"])]
    values = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "denoiser", inputs, outputs, values)
    # Versions that ONNX Runtime has read since 1.13.
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def main() -> None:
    """Learn the network and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("-o", "--output", type=Path, default=NETWORK)
    options = parser.parse_args()
    require_data()
    torch.manual_seed(options.seed)
    layers = untrained().to(memory_format=torch.channels_last)
    learn(layers, np.random.default_rng(options.seed), options.steps)
    save(layers, options.output)
    print(f"wrote {options.output}")


if __name__ == "__main__":
    main()
