"""Random arguments for the C extension: ``python -m benchmarks.fuzz.native [--count N] [--extension FILE]``.

To detect more than crashes, build the extension with sanitizers and load it as docs/developer/reliability.md describes.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType
from typing import Any

import numpy as np

from rsdeblur.kernels import native
from rsdeblur.kernels.rowwise import LANES, phase_table

ODD = (0, -1, 1, 2, 3, 7, 15, 16, 17, 40, 2**31, -(2**31), 2**62, -(2**63), 2**63 - 1)


def _number(rng: np.random.Generator, largest: int) -> int:
    return int(rng.integers(-1, largest + 2)) if rng.random() < 0.9 else int(rng.choice(ODD))


def _array(rng: np.random.Generator, kind: str, *shape: int) -> Any:
    """Return an array whose shape is nearly always `shape`; sides may be 0."""
    sides = [side if rng.random() < 0.95 else int(rng.integers(0, 9)) for side in shape]
    values = rng.random(sides, dtype=np.float32)
    return values.astype(np.complex64) if kind == "c" else values


def _lines(rng: np.random.Generator) -> tuple[str, list[Any]]:
    c, h, w, length, n = (int(rng.integers(0, 9)) for _ in range(5))
    length *= 3
    name = str(rng.choice("multiply blend picture_to_lines lines_to_picture rows_to_columns cut_lines".split()))  # noqa: SIM905
    taper = _array(rng, "f", int(rng.integers(0, length + 2)))
    truth = bool(rng.integers(2))
    return name, {
        "multiply": lambda: [_array(rng, "c", c, h, w), _array(rng, "c", h, w)],
        "blend": lambda: [
            *(_array(rng, "c", c, h, w), _array(rng, "c", c, h, length), _array(rng, "f", n)),
            *(_number(rng, w), _number(rng, length)),
        ],
        "picture_to_lines": lambda: [
            *(_array(rng, "f", h, w, c), _number(rng, h), _number(rng, h), _number(rng, 3 * length), taper, truth),
            _array(rng, "f", c, h, length),
        ],
        "lines_to_picture": lambda: [
            *(_array(rng, "f", c, h, length), _number(rng, h), _number(rng, length), _array(rng, "f", n)),
            *(_number(rng, w), truth, _array(rng, "f", h, w, c), _number(rng, h)),
        ],
        "rows_to_columns": lambda: [
            *(_array(rng, "c", c, h, 3 * w), _number(rng, w), _number(rng, h), _array(rng, "c", c, w, h + n)),
        ],
        "cut_lines": lambda: [
            *(_array(rng, "c", c, w, h), _number(rng, h), _number(rng, 3 * length), taper, truth),
            _array(rng, "c", c, w, length),
        ],
    }[name]()


def _rowwise(rng: np.random.Generator, extension: ModuleType) -> tuple[str, list[Any]]:
    """Return a call with a mostly valid model and a workspace of exactly the reported size."""
    blocks, rows, channels = (int(rng.integers(1, 6)) for _ in range(3))
    rows *= 3
    first = np.minimum(np.sort(rng.integers(0, rows + 1, blocks)), rows)
    end = np.minimum(first + rng.integers(0, 5, blocks), rows)
    coupled = np.array([rng.integers(0, b + 1) for b in range(blocks)])
    counts = rng.integers(0, 3, int(3 * (end - first).sum()))
    start, taps, phases = np.cumsum([0, *counts]), int(counts.sum()), int(rng.integers(1, 4))
    index = [first, end, coupled, start, rng.integers(0, phases, taps)]
    if rng.random() < 0.3:
        spoilt = index[int(rng.integers(len(index)))]
        if len(spoilt):
            spoilt[int(rng.integers(len(spoilt)))] = int(rng.choice([*ODD[:10], 2**31 - 1, -(2**31)]))
    model = [values.astype(np.int32) for values in index] + [rng.random(taps, dtype=np.float32)]
    model.append(phase_table(0, 0, phases, 50))
    name = str(rng.choice(["rowwise_forward", "rowwise_adjoint", "rowwise_solve"]))
    solve = name == "rowwise_solve"
    space = np.empty(extension.rowwise_workspace(*model, rows, int(solve)), np.float32)
    data, latent = _array(rng, "f", channels, rows, 2, LANES), _array(rng, "f", channels, 3 * blocks, 2, LANES)
    own = [rng.random(LANES, dtype=np.float32) + 1, float(rng.integers(2))] if solve else []
    return name, [*model, data, latent, space, *own]


def main() -> None:
    """Call functions with random arguments and count the outcomes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz.native", description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--extension", help="file of an extension to load instead of the installed one")
    options = parser.parse_args()
    extension = native
    if options.extension:
        loader = ExtensionFileLoader("_cext", options.extension)
        spec = spec_from_file_location("_cext", options.extension, loader=loader)
        assert spec is not None
        extension = module_from_spec(spec)
    if extension is None:
        sys.exit("there is no C extension")
    ends: Counter[str] = Counter()
    for number in range(options.count):
        rng = np.random.default_rng(number)
        try:
            name, arguments = _rowwise(rng, extension) if rng.random() < 0.5 else _lines(rng)
            getattr(extension, name)(*arguments)
            ends[f"{name} ran"] += 1
        except (ValueError, TypeError, OverflowError) as error:
            ends[f"refused: {type(error).__name__}"] += 1
    for end, count in sorted(ends.items()):
        print(f"{count:8} {end}")


if __name__ == "__main__":
    main()
