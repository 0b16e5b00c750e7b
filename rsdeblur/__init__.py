"""Remove camera-shake blur from rolling-shutter photos with the gyroscope's log.

:func:`deblur` does the whole work; its parts are public too. Every module or folder imports only those above it in this
list::

    errors      exceptions and warnings of the package
    types       names of array and callback types
    choices     named values of options
    _util       checks of arguments, safe files, threads, worker processes
    kernels     inner loops in C or Numba
    config      how this installation was built
    motion      gyro log, camera, exposure -> paths of the blur
    psf         PsfBank: kernels, drawn from paths or from elsewhere
    deconv      transforms, tiles, Wiener filter, priors, rowwise solver
    image       pixel encoding, tone curves, clipped highlights, light below black
    tuning      noise of a picture, strengths of the regularisation
    estimate    correction of a recording, time offset, check of a result
    calibration camera, clock and gyro's axes from clips or photos
    simulation  forward model, test scene, hand shake
    pipeline    deblur(), deconvolve() and plan(): from photo and motion to the sharp picture
    burst       deblur_burst(): several frames of one scene together
    io          files of gyro logs, cameras, captures and pictures
    video       videos, frame by frame
    report      drawings with Pillow, figures, pages of HTML
    plot        plots with Matplotlib
    app         the local page with sliders: server, crops
    cli         the command line
    __main__    python -m rsdeblur

`motion` imports nothing from `deconv`, and `deconv` knows neither gyro log nor camera nor exposure: it takes only
:class:`BlurPaths` and :class:`PsfBank`.

The names that most users need are those of `rsdeblur` itself. `motion`, `deconv`, `tuning`, `estimate`, `calibration`,
`pipeline`, `burst` and `simulation` have those of their parts and results, like `rsdeblur.motion.Capture`.
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

# Names are imported at their first use, so that `rsdeblur --help` and short scripts start at once.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
# `dir` lists the modules too; `from rsdeblur import *` leaves them out, as it would hide Python's `io`.
_MODULES = (
    *("calibration", "deconv", "errors", "estimate", "io", "motion", "pipeline", "plot", "report", "simulation"),
    "tuning",
)
__all__ = [*(name for name in __all__ if name not in _MODULES), "__version__"]
