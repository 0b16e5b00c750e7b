"""Time and memory of the parts of a deblurring. asv finds the measurements by their names."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from benchmarks.cases import EXPOSURE, NSR, Case
from rsdeblur import BlurPaths, Deconvolver, PsfBank, deblur
from rsdeblur.motion.paths import Capture
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.psf import tile_centres

SIZE = 1024, 768
BOX = 17, 59
BANDS = [1, 4, 16, 64]


class Solver:
    """The filter, by number of bands; one band is the global mode."""

    params = BANDS
    param_names = ("bands",)

    def setup(self, bands: int) -> None:
        """Plan the solver."""
        self.case = Case(*SIZE, BOX)
        self.bank = self.case.bank(bands)
        self.picture, self.out = self.case.sharp, np.empty(self.case.shape, dtype=np.float32)
        self.solver = Deconvolver(self.bank, self.case.shape, nsr=NSR)

    def time_apply(self, bands: int) -> None:
        """Deblur into a given array."""
        self.solver.apply(self.picture, out=self.out)

    def time_plan(self, bands: int) -> None:
        """Compute filters from PSFs; the FFT plans of this size are cached."""
        Deconvolver(self.bank, self.case.shape, nsr=NSR)

    def peakmem_plan_and_apply(self, bands: int) -> None:
        """Peak memory of the whole process."""
        Deconvolver(self.bank, self.case.shape, nsr=NSR).apply(self.picture, out=self.out)


class Motion:
    """From the raw log to PSFs, by number of bands."""

    params = BANDS
    param_names = ("bands",)

    def setup(self, bands: int) -> None:
        """Make the log, and load compiled kernels."""
        self.case = Case(*SIZE, BOX)
        self.log = self.case.log(bands)
        self.time_psfs(bands)

    def time_psfs(self, bands: int) -> None:
        """Integrate, trace and rasterise."""
        psfs(self.log, self.case.camera, EXPOSURE, bands=bands, strips=1)


class Kernels:
    """The rasteriser, without tracing."""

    def setup(self) -> None:
        """Trace 64 x 64 paths, and load compiled kernels."""
        case = Case(*SIZE, BOX)
        rows, cols = tile_centres(64, case.height), tile_centres(64, case.width)
        self.paths = BlurPaths.from_capture(Capture.from_log(case.log(16), case.camera, EXPOSURE), rows, cols)
        self.time_rasterize_4096()

    def time_rasterize_4096(self) -> None:
        """Draw 4,096 kernels."""
        PsfBank.from_paths(self.paths)


class Slabs:
    """A picture of 12 megapixels, whole and in bounded memory."""

    params: ClassVar = [None, 256 << 20]
    param_names = ("max_memory",)

    def setup(self, max_memory: int | None) -> None:
        """Make the picture; its memory is part of the peak."""
        self.case = Case(4000, 3000, BOX)
        self.log = self.case.log(16)
        self.picture = (255 * self.case.sharp).astype(np.uint8)
        self.out = np.empty_like(self.picture)

    def time_deblur(self, max_memory: int | None) -> None:
        """Deblur, from the log to the picture."""
        recording = self.log, self.case.camera, EXPOSURE
        deblur(
            self.picture,
            *recording,
            bands=16,
            strips=1,
            nsr=NSR,
            saturation="ignore",
            max_memory=max_memory,
            out=self.out,
            prior="wiener",
        )

    def peakmem_deblur(self, max_memory: int | None) -> None:
        """Peak memory of the whole process."""
        self.time_deblur(max_memory)
