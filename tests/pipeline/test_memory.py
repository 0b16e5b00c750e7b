"""Laws of bounded memory: chunks write every row once, and the result is that of the picture solved whole."""

from functools import partial

import numpy as np
import pytest

import rsdeblur
from rsdeblur import Camera, Exposure, GyroLog, InputError, hand_shake, scene, simulate
from rsdeblur.pipeline import memory
from rsdeblur.simulation import Simulation

# The published method's filter unless a test says otherwise: fast, and linear in the picture.
deblur = partial(rsdeblur.deblur, prior="wiener")

HEIGHT, WIDTH = 400, 96
CAMERA = Camera(WIDTH, HEIGHT, 500.0, readout_time=0.03)
EXPOSURE = Exposure(0.06, 1 / 50)
BANDS = {"bands": 12, "strips": 2}
ROWS = {"mode": "rowwise", "strips": 2}
# Options, and bytes for which the picture is cut into a few chunks. Priors have their automatic weights.
METHODS = {
    "banded": ({**BANDS, "nsr": 0.02}, 1_700_000),
    "rowwise": ({**ROWS, "nsr": 0.02}, 1_700_000),
    "global tv": ({"mode": "global", "prior": "tv"}, 2_700_000),
    "rowwise wavelet": ({**ROWS, "prior": "wavelet"}, 3_000_000),
    "banded wavelet": ({**BANDS, "prior": "wavelet"}, 4_000_000),
}


@pytest.fixture(scope="module")
def log() -> GyroLog:
    return hand_shake(0.2, seed=3)


@pytest.fixture(scope="module")
def capture(log: GyroLog) -> Simulation:
    return simulate(scene(HEIGHT + 40, WIDTH + 60), log, CAMERA, EXPOSURE, noise=0.003)


@pytest.fixture
def planned(monkeypatch):
    """Record the chunks, without the fixed part of the memory, so that small pictures can be cut."""
    chunks = []

    def plan(*args):
        chunks[:] = plan_chunks(*args)
        return chunks

    plan_chunks = memory.plan_chunks
    monkeypatch.setattr(memory, "FIXED", 0)
    monkeypatch.setattr("rsdeblur.pipeline.steps.plan_chunks", plan)
    return chunks


@pytest.mark.parametrize("name", METHODS)
def test_chunks_give_the_picture_that_is_solved_whole(capture, log, planned, name):
    arguments, (options, most) = (capture.blurred, log, CAMERA, EXPOSURE), METHODS[name]
    whole = deblur(*arguments, **options)
    assert len(planned) == 1
    sliced = deblur(*arguments, **options, max_memory=most)
    assert len(planned) > 1
    rows = [row for chunk in planned for row in range(chunk.target.start, chunk.target.stop)]
    assert rows == list(range(HEIGHT))
    assert all(chunk.source.start <= chunk.target.start and chunk.target.stop <= chunk.source.stop for chunk in planned)
    assert (sliced.bands, sliced.strips) == (whole.bands, whole.strips)
    for chunk in planned[1:]:
        near = np.s_[chunk.target.start - 8 : chunk.target.start + 9, 24:-24]
        change = np.sqrt(np.mean((sliced.image - whole.image)[near] ** 2))
        losses = [np.mean((image - capture.rolling)[near] ** 2) for image in (whole.image, sliced.image)]
        # A step of 8 bits, and 0.05 dB. Measured: 0.0022 with one filter for the picture, below 0.0012 otherwise.
        assert change < 0.004
        assert 10 * np.log10(losses[1] / losses[0]) < 0.05


def test_too_little_memory_is_refused_before_the_work(capture, log, monkeypatch):
    monkeypatch.setattr(memory, "FIXED", 0)
    with pytest.raises(InputError, match=r"max_memory is 0 MiB, but even 16 rows of this picture need \d+ MiB"):
        deblur(capture.blurred, log, CAMERA, EXPOSURE, max_memory=2**18)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_results_are_written_to_out(capture, log, tmp_path, dtype):
    """Also between memory-mapped files; integers are rounded."""
    top = 1 if dtype == np.float32 else np.iinfo(dtype).max
    np.save(tmp_path / "in.npy", (capture.blurred.clip(0, 1) * top).astype(dtype))
    blurred = np.load(tmp_path / "in.npy", mmap_mode="r")
    out = np.lib.format.open_memmap(tmp_path / "out.npy", mode="w+", dtype=dtype, shape=blurred.shape)
    result = deblur(blurred, log, CAMERA, EXPOSURE, nsr=0.02, out=out)
    assert result.image is out
    expected = deblur(np.array(blurred), log, CAMERA, EXPOSURE, nsr=0.02).image
    if dtype != np.float32:
        expected = np.rint(expected * np.float32(top))
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), expected)
