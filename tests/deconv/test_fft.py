"""Laws of the transforms, and of keeping measured plans."""

from multiprocessing import get_context

import numpy as np
import pytest

from rsdeblur import RsdeblurWarning
from rsdeblur.choices import PLANNINGS
from rsdeblur.deconv import fft


@pytest.fixture
def cache_dir(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(fft, "wisdom_file", lambda: tmp_path / "rsdeblur" / "test.wisdom")
    fft._warn_not_kept.cache_clear()
    return tmp_path / "rsdeblur"


@pytest.mark.parametrize("planning", PLANNINGS)
@pytest.mark.parametrize("n", [2, 29, 30])
def test_rows_are_numpys_transform_and_come_back(planning, n):
    rng = np.random.default_rng(0)
    rows = fft.RowTransform((2, 3, n), planning)
    values = rng.random((2, 3, n)).astype(np.float32)
    rows.real[...] = values
    rows.forward()
    # 30 values of order 1 are summed in float32.
    np.testing.assert_allclose(rows.spectra, np.fft.rfft(values), atol=1e-5)
    rows.inverse()
    np.testing.assert_allclose(rows.real / n, values, atol=1e-6)


def test_measured_plans_are_kept_and_damage_is_harmless(cache_dir):
    fft.LineTransform((3, 48), "measure")
    fft.remember()
    (kept,) = cache_dir.iterdir()
    good = kept.read_bytes()
    assert b"fftwf_wisdom" in good
    kept.write_bytes(good[: len(good) // 2])
    assert not fft._stored()
    fft.remember()
    assert kept.read_bytes() == good
    assert [path.name for path in cache_dir.iterdir()] == [kept.name]


@pytest.mark.parametrize("length", [210, 360])
def test_what_was_measured_changes_no_estimated_transform(cache_dir, monkeypatch, length):
    """The same bits from a new process, after plans were measured there, and after others were stored."""
    monkeypatch.setattr(fft, "_measured", [])
    rng = np.random.default_rng(length)
    values = rng.standard_normal((4, length)) + 1j * rng.standard_normal((4, length))

    def transformed(planning="estimate"):
        lines = fft.LineTransform((4, length), planning)
        lines.lines[...] = values
        lines.forward()
        return lines.spectra

    alone = transformed()
    # Measured plans may or may not give other bits.
    transformed("measure")
    fft.remember()
    np.testing.assert_array_equal(transformed(), alone)
    fft._measured.extend(fft._stored())
    np.testing.assert_array_equal(transformed(), alone)


def test_a_cache_that_cannot_be_written_costs_one_warning(cache_dir):
    # A file in place of the folder: unlike permissions, it stops root, too.
    cache_dir.write_text("")
    with pytest.warns(RsdeblurWarning, match="cannot be kept"):
        fft.remember()
    fft.remember()  # a second warning would be an error


def _knows(answers):
    """Answer whether a process that has measured nothing knows a plan before it measures it."""
    fft._recall.cache_clear()
    fft._measured.clear()
    before = fft._stored()
    fft.LineTransform((3, 48), "measure")
    fft.remember()
    answers.put(before == fft._stored())


@pytest.mark.usefixtures("cache_dir")
def test_another_process_uses_stored_plans():
    context = get_context("fork")
    answers = context.SimpleQueue()
    for knew in (False, True):
        process = context.Process(target=_knows, args=(answers,))
        process.start()
        assert answers.get() == knew
        process.join()
