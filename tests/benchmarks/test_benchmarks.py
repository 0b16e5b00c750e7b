"""Baselines, and the benchmarks' own machinery: how times are compared, and what happens where something is missing."""

import importlib
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from rsdeblur import Deconvolver, PsfBank
from tests.installed import needs


@pytest.fixture
def module():
    """Import a module of the benchmarks; some want what is not installed."""
    return lambda name: importlib.import_module(f"benchmarks.{name}")


class FakeClock:
    """A clock that only jobs move."""

    def __init__(self):
        self.now = 0.0
        self.calls = []

    def __call__(self):
        return self.now

    def job(self, name, durations):
        pending = iter(durations)

        def run():
            self.calls.append(name)
            self.now += next(pending)

        return run


def test_first_round_is_not_counted_and_the_rest_is_summarised(module):
    timing, clock = module("timing"), FakeClock()
    jobs = {"steady": clock.job("steady", [100, 4, 4, 4, 4, 4]), "rising": clock.job("rising", [100, 1, 2, 3, 4, 50])}
    times = timing.interleave(jobs, 5, clock=clock)
    assert list(times) == ["steady", "rising"]
    assert times["steady"] == timing.Times(4, 4, 4)
    # One outlier moves neither the median nor a quartile.
    assert times["rising"] == timing.Times(median=3, low=2, high=4)
    assert times["steady"] / times["rising"] == pytest.approx(4 / 3)


def test_calls_that_the_host_interrupted_are_measured_again(module):
    clock = FakeClock()
    # Two undisturbed calls last 0.5 s; the faster one counts. The host interrupts the first and the third.
    job = clock.job("job", [0.75, 0.25, 0.1, 0.375, 9.0])
    lost = iter([0.0, 0.5, 0.5, 0.5, 0.5, 1.5, 1.5, 1.5])
    assert module("timing").fastest(job, clock, lambda: next(lost)) == 0.25
    assert len(clock.calls) == 4


def test_figures_of_several_runs_make_one_page(module, tmp_path, monkeypatch):
    """Each run writes some groups' figures; the page shows all, in the order of the groups."""
    needs("plot")
    paper, figure = module("paper.__main__"), module("paper.figure")

    def made(name):
        curves = {"a": [1.0, 2.0]}
        return figure.Figure(
            name,
            f"Title of {name}",
            "What was done.",
            "Holds: 1.",
            ("x", "a"),
            [(0.0, 1.0), ("b", 2.0)],
            figure.lines([0.0, 1.0], curves, "x", "y"),
        )

    groups = {name: SimpleNamespace(figures=lambda quick, name=name: iter([made(name)])) for name in ("first", "last")}
    monkeypatch.setattr(paper, "GROUPS", groups)
    for name in ("last", "first"):
        assert "Holds: 1." in next(paper.run(name, tmp_path, quick=True))
    page = paper.page(tmp_path, load=0.0)
    assert page.index("## Title of first") < page.index("## Title of last")
    assert "[Numbers](paper/last.csv)" in page
    assert (tmp_path / "first.csv").read_text() == "x,a\n0.0,1.0\nb,2.0\n"
    assert "<svg" in (tmp_path / "last.svg").read_text()


NOISE = 0.003


@cache
def photograph():
    """Return a photograph that comes with scikit-image, roughly in linear light."""
    return (data.camera()[64:288, 128:352] / 255.0) ** 2.2


@pytest.fixture(scope="module")
def psf():
    """A bent trail in a box of 15 px."""
    t = np.linspace(-1, 1, 600)
    y, x = 7 * t**3 - 2 * t, 7 * np.sin(1.4 * t) + 2 * t**2 - 1
    kernel, _, _ = np.histogram2d(y, x, bins=15, range=[[-7.5, 7.5]] * 2)
    return kernel / kernel.sum()


@pytest.fixture(scope="module")
def blurred(psf):
    clean = ndimage.convolve(photograph(), psf, mode="reflect")
    return clean + np.random.default_rng(0).normal(0, NOISE, clean.shape)


def psnr(image):
    truth = photograph()
    inside = np.s_[24:-24, 24:-24]
    return peak_signal_noise_ratio(truth[inside], image.clip(0, 1)[inside], data_range=1.0)


@pytest.mark.parametrize("name", ["tv_l1", "richardson_lucy", "unsupervised_wiener"])
def test_a_known_psf_is_undone(module, name, psf, blurred):
    result = getattr(module("baselines"), name)(blurred, psf)
    assert result.dtype == np.float32
    # At least half of the squared error is removed; all three do far better on this picture.
    assert psnr(result) > psnr(blurred) + 3


def test_the_blind_estimator_finds_a_15_px_kernel(module, psf, blurred):
    baselines = module("baselines")
    estimate = baselines.estimate_psf(blurred, 21)
    assert estimate.min() >= 0
    assert estimate.sum() == pytest.approx(1, abs=1e-5)
    # Two different trails in a box of 15 px correlate by 0.5 to 0.6; published estimators reach 0.8 to 0.95.
    assert baselines.kernel_similarity(estimate, psf) > 0.8
    restored = Deconvolver(PsfBank.for_picture(estimate, blurred.shape), blurred.shape, nsr=0.01).apply(blurred)
    # The kernel is estimated up to a shift.
    shifts = [np.roll(restored, (dy, dx), (0, 1)) for dy in range(-2, 3) for dx in range(-2, 3)]
    assert max(map(psnr, shifts)) > psnr(blurred) + 1
