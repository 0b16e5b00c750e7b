"""Remove camera-shake blur from rolling-shutter photos with the gyroscope's log.

:func:`deblur` is the one call; the parts it is made of are public too. A module imports, when it is loaded, only what
stands above it in this ladder::

    errors      what the package raises
    _validate   checks at the public doors
    _regular    reading files that are no pipes or devices
    _atomic     files that appear whole or not at all
    kernels     inner loops, C or Numba, each with a NumPy twin; they import only errors
    config      how this installation was built
    axes        how an IMU sits in a camera: orientation strings, presets
    lens        lens distortion and its inverse
    camera      Camera: intrinsics, lens, readout, relation to the IMU
    exposure    Exposure: the window of each row
    gyro        GyroLog, OrientationTrack
    translation Translation: where the camera was, and the scene's depth
    motion      BlurPaths: displacement paths on a grid of rows and strips
    psf         PsfBank: kernels drawn from paths, or given
    fft         the only importer of pyFFTW: transforms, measured plans kept on disk
    tiling      bands and strips, windows that sum to one
    border      what stands beyond the frame
    extension   pictures made to repeat without a seam: rivals of the default border
    crew        threads that share blocks of work, after a fork too
    hybrid      rows and columns: the engine of all modes
    wiener      filters of tiles; Deconvolver: planned once, applied often
    lanes       row spectra sorted into blocks of 16 frequencies
    rowblur     RowBlur: the blur of every row and its adjoint
    rowcg       the rowwise solve by conjugate gradients
    rowwise     RowDeconvolver: the exact solve
    priors      gradient, total variation, hyper-Laplacian, on top of a quadratic solver
    quadratic   that solver for tiles
    noise       how noisy a picture is, and how much goes on in it
    tuning      how strongly to regularise
    transfer    linear light and sRGB
    stored      pictures as stored, and rows of them as light
    geometry    from the rolling picture to the global-shutter one
    method      mode, prior and their numbers in one place
    saturation  highlights beyond full scale, taken out and put back
    slabs       large pictures in bounded memory
    timing      the clock offset, found in the picture
    check       whether to trust a result
    pipeline    deblur(): the one call
    baselines   what others do: opponents for experiments
    simulate    the forward model, sharing no code with psf
    scene       a sharp test picture
    shake       a hand-shake log
    io          gyro logs, camera files, pictures
    workers     tasks in processes of their own, or on a cluster
    records     what of a long run is done
    video       videos, frame by frame
    report      plots and contact sheets
    cli         the command line
    __main__    python -m rsdeblur

Two branches meet in the middle: `gyro` to `psf` never see an FFT, `fft` to `tuning` never see a gyro.
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
