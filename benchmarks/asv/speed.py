"""Time and memory of the parts of a deblurring. asv finds the measurements by their names."""

from __future__ import annotations

import numpy as np

from benchmarks.cases import EXPOSURE, NSR, Case
from rsdeblur import Deconvolver
from rsdeblur.pipeline.deblur import psfs

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
