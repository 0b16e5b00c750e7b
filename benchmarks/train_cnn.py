"""Learn the denoiser of the prior "cnn": ``python -m benchmarks.train_cnn``; writes rsdeblur/deconv/cnn.onnx.

Needs the extra `train` (PyTorch), and one or two hours on two cores. The pictures are those of
`benchmarks.train_wavelet` and more that scikit-image and scikit-learn contain; the benchmarks use none of them.

First the network learns to remove white noise. Then it learns on the steps of :class:`rsdeblur.PlugAndPlayPrior`, too:
what a solve leaves of noise, wrong motion, JPEG and a phone's processing is not white. Eighty captures are restored at
a time, each at its own step; the network's own result leads to the next one.

Everything is seeded, but sums of threads differ in their last bits, and so does the network after many steps.
"""

from __future__ import annotations

import argparse
import math
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import skimage.data
import sklearn.datasets
import torch
from onnx import helper, numpy_helper
from rich.progress import track
from scipy.signal import fftconvolve

from benchmarks.captures import Image, require_data
from benchmarks.phone import TRUTH_NOISE, TRUTH_QUALITY, processed
from benchmarks.priors import jpeg
from benchmarks.train_wavelet import EXPOSURE, SIDE, kernel, pictures, reduced
from rsdeblur import (
    Camera,
    InputError,
    PlugAndPlayPrior,
    PsfBank,
    Tuning,
    from_linear,
    hand_shake,
    psfs,
    to_linear,
)
from rsdeblur.deconv.boundary import smooth
from rsdeblur.deconv.cnn import NETWORK
from rsdeblur.deconv.plug_and_play import STEPS
from rsdeblur.deconv.priors import brightness
from rsdeblur.deconv.wavelet import OPPONENT

# Layers, and planes between them.
LAYERS, PLANES = 10, 48
# Steps of both parts; the learning rate, which falls by one cosine over both, and the share of it in the first; steps
# over which the rate rises at the start of a part; limit of the gradient's norm; share of each step in the average of
# the factors, which is what is kept.
PARTS, RATE, FIRST, RISE, CLIP, AVERAGE = (5000, 6000), 1.2e-3, 0.54, (200, 50), (0.05, 1.0), (0.005, 0.004)
# White noise in units of 255; crops per step in both parts, and their side, px.
NOISES, CROPS, CROP = (0.5, 60.0), (24, 6), 96
# Captures; those under way, those per step, and the share of the loss that white noise has beside them.
CAPTURES, UNDER_WAY, PER_STEP, WHITE = 3000, 80, 4, 0.5
# Side of the periodic frame that a capture is continued to, and the border that does not count, px.
FRAME, BORDER = 240, 8
# Longest side of the PSF, px; relative error of its size, delay in s, and drift in px and as a share of that side.
SIZES, SIZE_ERROR, DELAY, DRIFT = (2.0, 44.0), 0.05, 0.002, (0.3, 0.05)
# Captures that are wrong, photos of phones, light in sRGB, JPEG: shares. A phone's noise, and what its processing
# reads beyond the crop, px.
WRONG, PHONES, ENCODED, JPEGS = 0.55, 0.35, 0.4, 0.3
PHONE_NOISES, PHONE_MARGIN = (0.003, 0.006, 0.012, 0.02), 8


class Capture(NamedTuple):
    """One plane of a blurred picture, continued periodically, its truth, and what the solver takes for its blur."""

    blurred: Image
    sharp: Image
    kernel: Image
    slope: Image
    sigmas: list[float]
    weight: float


@cache
def sources() -> list[Image]:
    """Return the sharp pictures."""
    textures, photos = Path(skimage.data.__file__).parent, Path(sklearn.datasets.__file__).parent / "images"
    more = {textures / f"{name}.png": (1,) for name in ("brick", "grass", "gravel", "page", "coins")}
    return pictures() + reduced(more | {photos / f"{name}.jpg": (1, 2) for name in ("china", "flower")})


def crop(rng: np.random.Generator, tall: int, wide: int) -> Image:
    """Return a part of one of the pictures; those are drawn by the root of their size."""
    sides = np.array([(tall <= each.shape[0] and wide <= each.shape[1]) * each[..., 0].size for each in sources()])
    source = sources()[rng.choice(len(sides), p=np.sqrt(sides) / np.sqrt(sides).sum())]
    top, left = rng.integers(source.shape[0] - tall + 1), rng.integers(source.shape[1] - wide + 1)
    return source[top : top + tall, left : left + wide]


def plane(rng: np.random.Generator) -> Image:
    """Return one plane of a crop, turned at random: a channel, the brightness, or a difference of colour."""
    part = crop(rng, CROP, CROP)
    light = to_linear(part, "srgb") if rng.random() < ENCODED else part
    kind = rng.random()
    if kind < 0.2:
        taken = light[..., rng.integers(3)]
    else:
        taken = light @ (OPPONENT[0] / 3**0.5 if kind < 0.75 else OPPONENT[rng.integers(1, 3)])
    turned = np.rot90(taken, int(rng.integers(4)))
    return np.ascontiguousarray(turned[::-1] if rng.random() < 0.5 else turned, dtype=np.float32)


def believed_and_true(rng: np.random.Generator) -> tuple[Image, Image]:
    """Return the PSF that is believed, and the true one."""
    camera, shake = Camera(SIDE, SIDE, 1000.0), hand_shake(0.2, seed=int(rng.integers(2**31)))
    aim = float(np.exp(rng.uniform(*np.log(SIZES))))
    size = aim / max(psfs(shake, camera, EXPOSURE, mode="global").size)
    if rng.random() > WRONG:
        return (kernel(shake, camera, size),) * 2
    error, delay = rng.uniform(-1, 1, 2) * (SIZE_ERROR, DELAY)
    x, y = rng.normal(size=2) * (DRIFT[0] + DRIFT[1] * aim)
    return kernel(shake, camera, size), kernel(shake, camera, size * (1 + error), delay, (x, y))


def capture(rng: np.random.Generator) -> Capture:
    """Draw a capture.

    Raises
    ------
    InputError
        If the motion that was drawn is too large.
    """
    believed, true = believed_and_true(rng)
    phone = rng.random() < PHONES
    margin = PHONE_MARGIN if phone else 0
    part = crop(rng, *(SIDE + 2 * margin + n - 1 for n in true.shape))
    encoded = phone or rng.random() < ENCODED
    light = to_linear(part, "srgb") if encoded else part
    if not encoded and rng.random() < 0.7:
        light = light.mean(axis=2, keepdims=True)
    blurred = fftconvolve(light, true[:, :, None], "valid", axes=(0, 1)).astype(np.float32)
    noise: float | None = None
    sharp = light[tuple(slice(n // 2, n // 2 + SIDE + 2 * margin) for n in true.shape)]
    if phone:
        # What the phone would have made of the sharp picture is the truth, as in `benchmarks.phone`.
        sharp = photo(sharp, rng, noise=TRUTH_NOISE, quality=TRUTH_QUALITY)
        blurred = photo(blurred, rng, noise=rng.choice(PHONE_NOISES), quality=int(rng.integers(80, 97)))
    else:
        noise = float(np.exp(rng.uniform(*np.log((0.5, 16.0))))) / 255
        blurred = (blurred + rng.normal(0, noise, blurred.shape)).astype(np.float32)
        stored = encoded and rng.random() < JPEGS
        blurred = jpeg(blurred) if stored else blurred
        noise = noise if not stored and rng.random() < 0.3 else None
    bank = PsfBank.for_picture(believed, blurred.shape)
    if max(bank.size) > FRAME - SIDE:
        raise InputError("the blur is larger than the frame can hold")
    tuning = Tuning.of(blurred, bank, noise=noise, one_filter=True)
    prior = PlugAndPlayPrior(lambda image, _: image, tuning.denoiser_weight, brightness(blurred))
    slope = np.ones((SIDE, SIDE))
    if encoded:
        level = sharp.mean(axis=2).clip(5e-3, 1)
        slope = (from_linear(level * 1.01, "srgb") - from_linear(level, "srgb")) / (0.01 * level)
    mix = OPPONENT if blurred.shape[2] == 3 else np.eye(1)
    axis = mix[0 if rng.random() < 0.6 else rng.integers(len(mix))].astype(np.float32)
    placed = np.zeros((FRAME, FRAME), dtype=np.float32)
    placed[: believed.shape[0], : believed.shape[1]] = believed
    placed = np.roll(placed, [-(n // 2) for n in believed.shape], axis=(0, 1))
    frame = smooth(blurred, FRAME, FRAME) @ axis
    return Capture(frame, sharp @ axis, placed, slope.astype(np.float32), prior.sigmas, prior.weight)


def photo(light: Image, rng: np.random.Generator, *, noise: float, quality: int) -> Image:
    """Return the linear light of a phone's photo, without the margin."""
    stored = processed(light, rng, noise=noise, quality=quality)[PHONE_MARGIN:-PHONE_MARGIN, PHONE_MARGIN:-PHONE_MARGIN]
    return to_linear(stored.astype(np.float32) / np.float32(255), "srgb")


def captures(rng: np.random.Generator) -> list[Capture]:
    """Draw all captures."""
    found: list[Capture] = []
    while len(found) < CAPTURES:
        try:
            found.append(capture(rng))
        except InputError:
            continue
    return found


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


def denoised(layers: Any, planes: Any, sigmas: Any) -> Any:
    """Return planes (N, H, W) without noise of the standard deviations `sigmas` (N)."""
    quarters = torch.nn.functional.pixel_unshuffle(planes[:, None], 2)
    level = sigmas.view(-1, 1, 1, 1).expand(-1, 1, *quarters.shape[2:])
    noise = layers(torch.cat([quarters, level], 1))
    return planes - torch.nn.functional.pixel_shuffle(noise, 2)[:, 0]


class Steps:
    """Captures under way, each at its own step."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._all = rng, captures(rng)
        self._way: list[tuple[Capture, int, Any]] = [self._fresh() for _ in range(UNDER_WAY)]
        down, across = torch.fft.fftfreq(FRAME)[:, None], torch.fft.rfftfreq(FRAME)
        self._gradient = 4 - 2 * torch.cos(2 * math.pi * down) - 2 * torch.cos(2 * math.pi * across)

    def loss(self, layers: Any) -> Any:
        """Return the logarithm of the squared errors after a step of some captures, which so become ready for the next.

        Later steps count more.
        """
        total = 0.0
        for n in self._rng.choice(UNDER_WAY, PER_STEP, replace=False):
            one, step, latent = self._way[n]
            sigma = torch.tensor([one.sigmas[step]])
            result = denoised(layers, self._solved(one, one.sigmas[step], latent)[None], sigma)[0]
            error = (result[:SIDE, :SIDE] - torch.from_numpy(one.sharp)) * torch.from_numpy(one.slope)
            mean = error[BORDER:-BORDER, BORDER:-BORDER].square().mean()
            total += (0.5 + step / (STEPS - 1)) * torch.log(mean + 1e-6) / PER_STEP
            self._way[n] = (one, step + 1, result.detach()) if step < STEPS - 1 else self._fresh()
        return total

    def _fresh(self) -> tuple[Capture, int, Any]:
        return self._all[self._rng.integers(len(self._all))], 0, None

    def _solved(self, one: Capture, sigma: float, latent: Any) -> Any:
        transfer, observed = (torch.fft.rfft2(torch.from_numpy(each)) for each in (one.kernel, one.blurred))
        matched, power, beta = observed * transfer.conj(), transfer.abs().square(), one.weight / sigma**2
        start = matched / (power + beta * self._gradient) if latent is None else torch.fft.rfft2(latent)
        return torch.fft.irfft2((matched + beta * start) / (power + beta), s=(FRAME, FRAME))


def white_loss(layers: Any, rng: np.random.Generator, part: int) -> Any:
    """Return the loss of crops with white noise: weighted squares first, then logarithms as for captures."""
    sharp = torch.from_numpy(np.stack([plane(rng) for _ in range(CROPS[part])]))
    least, most = NOISES
    levels = least * (most / least) ** rng.random(CROPS[part]) / 255
    sigmas = torch.from_numpy(levels.astype(np.float32))
    error = denoised(layers, sharp + sigmas[:, None, None] * torch.randn_like(sharp), sigmas) - sharp
    squares = error.square().mean((1, 2))
    return (squares / sigmas).mean() if part == 0 else torch.log(squares / sigmas**2).mean()


def learn(layers: Any, rng: np.random.Generator, part: int) -> None:
    """Learn one of the two parts."""
    optimizer = torch.optim.Adam(layers.parameters())
    mean = [each.detach().clone() for each in layers.parameters()]
    steps = Steps(rng) if part == 1 else None
    for n in track(range(PARTS[part]), ("white noise", "captures")[part]):
        share = part * FIRST + (1 - FIRST if part else FIRST) * n / PARTS[part]
        rate = RATE * 0.5 * (1 + math.cos(math.pi * share)) * min(1.0, (n + 1) / RISE[part])
        for group in optimizer.param_groups:
            group["lr"] = rate
        optimizer.zero_grad()
        loss = white_loss(layers, rng, part)
        if steps:
            loss = WHITE * loss + steps.loss(layers)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(layers.parameters(), CLIP[part])
        optimizer.step()
        for each, now in zip(mean, layers.parameters(), strict=True):
            each.lerp_(now.detach(), AVERAGE[part])
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
    parser.add_argument("-o", "--output", type=Path, default=NETWORK)
    options = parser.parse_args()
    require_data()
    torch.manual_seed(options.seed)
    rng, layers = np.random.default_rng(options.seed), untrained().to(memory_format=torch.channels_last)
    for part in (0, 1):
        learn(layers, rng, part)
    save(layers, options.output)
    print(f"wrote {options.output}")


if __name__ == "__main__":
    main()
