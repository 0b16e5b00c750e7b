"""What `deconvolve` says of right and wrong kernels: ``python -m benchmarks.kernels [--seed N]``.

Photographs are blurred by the kernels of Levin et al. (2009), or by a field of straight blurs; the kernels are then
given right, turned by half a turn, with the other encoding, or in another size. Each cell of the table has how many of
them are remarked: of right ones none should be. The last column has of how many of the right size another is named.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from benchmarks import data
from benchmarks.data import Image, noted
from benchmarks.phone import phone_photo
from benchmarks.refine import PICTURES, landscape
from benchmarks.tables import markdown
from rsdeblur import Options, PsfBank
from rsdeblur.choices import Transfer
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.transfer import from_linear
from rsdeblur.pipeline.deconvolve import remarks_on

# Kernels that belong to light; to stored values; to light, as a phone stores it; and lines of a field, to light.
KINDS = "light", "stored values", "phone", "field"
# Sizes of the true blur over that of the kernel that is given.
SIZES = 0.8, 1.25
# Noise of stored values, standard deviation.
NOISE = 0.004


def kernels_of(n: int, kind: str, shape: tuple[int, ...]) -> PsfBank:
    """Return the PSFs of a case: a kernel of Levin et al., or lines that change across the picture."""
    if kind != "field":
        return PsfBank.for_picture(data.kernels()[n], shape)
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    turn = 0.4 * n
    return PsfBank.from_field(12 * np.cos(turn) + 4 * y, 12 * np.sin(turn) + 4 * x, tile=128)


def picture_of(n: int, kind: str, scene: Image, bank: PsfBank, random: np.random.Generator) -> NDArray[np.uint8]:
    """Return a blurred picture of 8 bits."""
    sharp = from_linear(scene.clip(0, 1), "srgb") if kind == "stored values" else scene
    blurred = TileBlur(bank, sharp.shape).forward(np.ascontiguousarray(sharp, dtype=np.float32))
    if kind == "phone":
        return phone_photo(blurred, n)
    stored = blurred if kind == "stored values" else from_linear(blurred.clip(0, 1), "srgb")
    noisy = stored + random.normal(0, NOISE, stored.shape)
    return np.round(255 * noisy.clip(0, 1)).astype(np.uint8)


def turned(bank: PsfBank) -> PsfBank:
    """Return PSFs turned by half a turn."""
    return PsfBank(bank.kernels[..., ::-1, ::-1], bank.rows, bank.cols)


def cases(seed: int, kind: str) -> dict[str, tuple[int, int]]:
    """Return for each way to give the kernels of how many it is remarked, of how many."""
    random = np.random.default_rng(seed)
    counts: dict[str, list[bool]] = defaultdict(list)
    for n, name in enumerate(PICTURES):
        scene = landscape(name)
        bank = kernels_of(n, kind, scene.shape)
        right: Transfer = "linear" if kind == "stored values" else "srgb"
        other: Transfer = "srgb" if kind == "stored values" else "linear"
        picture = picture_of(n, kind, scene, bank, random)
        given = {
            "right": (picture, bank, right, ""),
            "turned": (picture, turned(bank), right, "half a turn"),
            "other encoding": (picture, bank, other, "transfer"),
        }
        for size in SIZES:
            blurred = picture_of(n, kind, scene, bank.scaled(size), random)
            given[f"x {size:g}"] = blurred, bank, right, "as large"
        for how, (shown, psfs, transfer, expected) in given.items():
            remarks = remarks_on(EncodedImage.of(shown, transfer), psfs, Options(mode="banded"))
            counts[how].append(any(expected in remark for remark in remarks))
            if not how.startswith("x "):
                counts["right size"].append(any("as large" in remark for remark in remarks))
    return {how: (sum(found), len(found)) for how, found in counts.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=2026)
    seed = parser.parse_args().seed
    found = {kind: cases(seed, kind) for kind in KINDS}
    columns = "right", "turned", "other encoding", *(f"x {size:g}" for size in SIZES), "right size"
    rows = [(kind, *("{} of {}".format(*found[kind][how]) for how in columns)) for kind in KINDS]
    print(noted(markdown(("kernels of", *columns), rows)))


if __name__ == "__main__":
    main()
