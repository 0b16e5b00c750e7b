"""The shake model: reproducible, a function of time, with the levels and bands of a real hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rsdeblur.errors import InputError
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.simulation.shake import hand_shake

BANDS = {"drift": (0.1, 2.0), "sway": (3.0, 7.0), "tremor": (8.0, 12.0)}


def band_rms(log: GyroLog, low: float, high: float) -> np.ndarray:
    """Return the rms rate per axis of a log between two frequencies in Hz."""
    t = np.arange(*log.span, 1.0 / 200.0)
    even = np.stack([np.interp(t, log.t, log.omega[:, axis]) for axis in range(3)], axis=1)
    frequency, power = signal.welch(even, 200.0, nperseg=2000, axis=0)
    inside = (frequency >= low) & (frequency <= high)
    return np.asarray(np.sqrt(power[inside].sum(axis=0) * frequency[1]))


def test_covers_the_duration() -> None:
    log = hand_shake(0.5, rate=210.0)
    assert log.span[0] == 0.0
    assert log.span[1] >= 0.5
    assert log.rate == pytest.approx(210.0)
    assert log.epoch_ns == 0


def test_strength_is_a_factor_and_seeds_differ() -> None:
    log = hand_shake(0.5, seed=1)
    np.testing.assert_allclose(hand_shake(0.5, seed=1, strength=0.25).omega, 0.25 * log.omega, atol=1e-15)
    assert not np.allclose(hand_shake(0.5, seed=2).omega, log.omega)
    assert not hand_shake(0.5, strength=0.0).omega.any()


def test_energy_lies_in_the_bands() -> None:
    log = hand_shake(60.0, seed=0)
    inside = sum(band_rms(log, low - 0.2, high + 0.2) ** 2 for low, high in BANDS.values())
    # Welch's window leaks about a bin of 0.1 Hz; 98 % leaves room for it.
    assert np.all(inside > 0.98 * band_rms(log, 0.0, 100.0) ** 2)


@pytest.mark.parametrize(
    "arguments", [{"duration": 0.0}, {"duration": 1.0, "rate": 20.0}, {"duration": 1.0, "strength": -1.0}]
)
def test_refuses_what_makes_no_log(arguments: dict[str, float]) -> None:
    with pytest.raises(InputError):
        hand_shake(**arguments)
