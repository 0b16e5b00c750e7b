"""Coverage-guided fuzzing with Atheris: ``python -m benchmarks.fuzz.guided HARNESS FOLDER [libFuzzer's options]``.

The folder contains the corpus, which begins with the harness's seeds and grows. ``--replay`` instead of a harness's
name uses every input of every harness once, seeds and ``FOLDER/HARNESS``, without Atheris: to measure what the corpus
covers.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

# Packages without a reader; Numba cannot compile instrumented code, and Atheris fails to instrument some of it.
NUMERIC = ("kernels", "deconv")


def replay(folder: Path) -> None:
    """Use the seeds and the corpus of every harness."""
    from benchmarks.fuzz.harnesses import HARNESSES, try_one

    for name, harness in HARNESSES.items():
        found = [path.read_bytes() for path in sorted(folder.glob(f"{name}/*"))]
        for data in [*harness.seeds(), *found]:
            try_one(harness, data)
        print(f"{name:14} {len(harness.seeds()):4} seeds {len(found):6} found")


def main() -> None:
    """Fuzz one harness until libFuzzer ends."""
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    name, folder = sys.argv[1], Path(sys.argv[2])
    if name == "--replay":
        replay(folder)
        return
    import atheris

    import rsdeblur

    rooms = Path(rsdeblur.__file__).parent
    left_out = [f"rsdeblur.{room}.{path.stem}" for room in NUMERIC for path in (rooms / room).glob("*.py")]
    # Modules that are imported only when they are needed are instrumented as well.
    with atheris.instrument_imports(include=["rsdeblur"], exclude=left_out):
        from benchmarks.fuzz.harnesses import HARNESSES, try_one

        harness = HARNESSES[name]
        folder.mkdir(parents=True, exist_ok=True)
        for data in harness.seeds():
            (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)
        atheris.Setup([sys.argv[0], *sys.argv[2:]], lambda data: try_one(harness, data))
        atheris.Fuzz()


if __name__ == "__main__":
    main()
