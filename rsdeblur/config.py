"""Facts about this installation: versions, compiler, SIMD level, threads."""

import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

from rsdeblur import _config
from rsdeblur.kernels import native, why_pure

LIBRARIES = ("numpy", "scipy", "numba", "pyfftw")
# Libraries under the GPL in the wheels of dependencies (docs/developer/licences.md).
GPL = {"pyfftw": "FFTW", "pillow-heif": "x265", "av": "x264 and x265"}


def show_config() -> None:
    """Print how rsdeblur was built and what it uses on this machine.

    These are the versions of rsdeblur, Python and libraries; whether the C extension is in use, or why it is not; the
    compiler that built it, and the instruction set that it uses; the default number of threads; and the licence, with
    the libraries under the GPL that wheels of installed packages bring.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.show_config()
    rsdeblur ...
    """
    for name, value in facts().items():
        print(f"{name:9} {value}")


def facts() -> dict[str, str]:
    """Return what :func:`show_config` prints."""
    # Not at the top: pyFFTW takes long to load, and threads load it too.
    from pyfftw import fftw_version

    from rsdeblur._util.threads import thread_count

    return {
        "rsdeblur": _config.VERSION,
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
        "fftw": str(fftw_version),
        "cext": "in use" if native else f"not in use ({why_pure}); the NumPy twins do the same, slower",
        "compiler": _config.COMPILER,
        "simd": native.SIMD if native else "none",
        "threads": str(thread_count(None)),
        "licence": f"BSD-3-Clause; under the GPL in wheels of dependencies: {_gpl()}",
    }


def _gpl() -> str:
    libraries = []
    for name, library in GPL.items():
        with suppress(PackageNotFoundError):
            version(name)
            libraries.append(f"{library} ({name})")
    return ", ".join(libraries)
