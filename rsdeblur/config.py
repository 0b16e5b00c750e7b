"""What this installation is made of."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import Literal, overload

from rsdeblur import _config
from rsdeblur._util import validate
from rsdeblur.kernels import native, why_pure

LIBRARIES = ("numpy", "scipy", "numba", "pyfftw")


@overload
def show_config(mode: Literal["stdout"] = "stdout") -> None: ...


@overload
def show_config(mode: Literal["dict"]) -> dict[str, str]: ...


def show_config(mode: Literal["stdout", "dict"] = "stdout") -> dict[str, str] | None:
    """Print how rsdeblur was built and what it runs on.

    Parameters
    ----------
    mode : {"stdout", "dict"}
        "dict" returns the facts instead of printing them.

    Returns
    -------
    dict of str or None
        Versions; `cext`, which is "in use" or says why the C extension is not; the compiler that built it and the
        instruction set it uses here, or "none"; and how many threads are used unless told otherwise.

    Raises
    ------
    InputError
        If `mode` is another.
    """
    # Not at the top: it would load pyFFTW.
    from rsdeblur._util.threads import thread_count

    validate.choice("mode", mode, ("stdout", "dict"))
    facts = {
        "rsdeblur": _config.VERSION,
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        "fftw": _fftw_version(),
        "cext": "in use" if native else f"not in use ({why_pure}); the NumPy twins do the same, slower",
        "compiler": _config.COMPILER,
        "simd": native.SIMD if native else "none",
        "threads": str(thread_count(None)),
    }
    if mode == "dict":
        return facts
    for name, value in facts.items():
        print(f"{name:9} {value}")
    return None


def _fftw_version() -> str:
    from pyfftw import fftw_version

    return str(fftw_version)
