"""Remove camera-shake blur from rolling-shutter photos with the gyroscope's log.

:func:`deblur` is the one call; its parts are public too. Every room imports only rooms above it in this ladder::

    errors      exceptions and warnings of the package
    types       names of array and callback types
    choices     the named choices of options
    _util       checks of arguments, safe files, threads, worker processes
    kernels     inner loops in C or Numba, each with a NumPy twin
    config      how this installation was built
    motion      gyro log, camera, exposure -> paths of the blur
    psf         PsfBank: kernels drawn from paths, or given
    deconv      transforms, tiles, Wiener filter, priors, rowwise solve
    image       pixel encoding, tone curves, clipped highlights
    estimate    noise, strengths, the clock offset, the check of a result
    simulation  forward model, test scene, hand shake
    pipeline    deblur(): from photo and motion to the sharp picture
    io          files: gyro logs, cameras, captures, pictures
    video       clips, frame by frame
    report      plots, contact sheets, the HTML report
    cli         the command line
    __main__    python -m rsdeblur

Two branches meet in the middle. `motion` never sees a transform; `deconv` never sees a gyro, a camera or an exposure.
Only :class:`BlurPaths` and :class:`PsfBank` cross from one to the other.
"""

try:
    from rsdeblur._config import VERSION as __version__
except ModuleNotFoundError as error:
    if error.name != "rsdeblur._config":
        raise
    raise ImportError(
        "rsdeblur was imported from its source folder, where the files made by the build are missing. "
        "Leave that folder (and take it off PYTHONPATH) to use an installed rsdeblur, or install it for development: "
        "pip install --no-build-isolation -e '.[dev]'"
    ) from None

import lazy_loader

# Names are imported when first used, so that `rsdeblur --help` and short scripts start at once.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]
