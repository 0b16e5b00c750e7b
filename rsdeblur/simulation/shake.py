"""A model of how a hand shakes a phone, for simulations that need no recording."""

from __future__ import annotations

import numpy as np

from rsdeblur._util import validate
from rsdeblur.motion.gyro import GyroLog

# Low and high edge in Hz, and rms rate in rad/s about x, y and z (z: roll about the optical axis).
DRIFT = (0.1, 2.0, (0.30, 0.26, 0.19))
SWAY = (3.0, 7.0, (0.72, 0.74, 0.50))
TREMOR = (8.0, 12.0, (0.61, 0.72, 0.27))

# Sinusoids in a band and axis: a sum of 32 is Gaussian to the eye and never repeats.
WAVES = 32


def hand_shake(duration: float, *, rate: float = 200.0, strength: float = 1.0, seed: int = 0) -> GyroLog:
    """Return the gyro log of a phone in a shaking hand.

    Three bands of noise add up on each axis: slow *drift* of the body (0.1 to 2 Hz), *sway* of the arm with the
    mass it holds (3 to 7 Hz), and the physiological *tremor* of the hand (8 to 12 Hz). Each band is a sum of
    sinusoids with frequencies and phases drawn once from `seed`, so the motion is a function of time: another
    duration or rate samples the same motion.

    Parameters
    ----------
    duration : float
        Length in s, positive; samples cover [0, duration].
    rate : float, default 200.0
        Sampling rate in Hz, above twice the tremor's upper edge (24 Hz).
    strength : float, default 1.0
        Factor on all rates, at least 0. At 1 each band has the rms of a real recording of a phone shaken on
        purpose (57 s at 210 Hz; 1.0, 1.1 and 0.6 rad/s rms about x, y and z); about 0.03 is a steady hold.
    seed : int, default 0
        Chooses the motion.

    Returns
    -------
    GyroLog
        Times from 0 s with epoch 0, rates in rad/s in axes that may serve as camera axes (z along the view).

    Raises
    ------
    InputError
        If an argument is out of its range.

    Notes
    -----
    Physiological hand tremor peaks between 6 and 12 Hz [1]_; the frequency of its mechanical part goes with
    sqrt(stiffness / inertia) [2]_, so an arm that holds a phone swings at a few Hz. A steady hold follows from the
    photographers' rule: at 1/f s (f in mm, 35 mm film) blur stays near 1/30 mm, hence about 0.03 rad/s.

    References
    ----------
    .. [1] M. Lakie et al., "Increased gravitational force reveals the mechanical, resonant nature of physiological
       tremor", J. Physiol. 593 (2015) 4411-4422.
    .. [2] R. J. Elble, "Physiologic and enhanced physiologic tremor", in M. Hallett (ed.), Movement Disorders,
       Handbook of Clinical Neurophysiology 1 (2003), chapter 22.
    """
    duration = validate.finite("duration", duration, above=0.0)
    rate = validate.finite("rate", rate, above=2.0 * TREMOR[1])
    strength = validate.finite("strength", strength, minimum=0.0)
    random = np.random.default_rng(validate.count("seed", seed, minimum=0))
    t = np.arange(np.ceil(duration * rate) + 1.0) / rate
    omega = np.zeros((len(t), 3))
    for low, high, rms in (DRIFT, SWAY, TREMOR):
        # One frequency from each of WAVES equal slices: the whole band is always present.
        slices = np.arange(WAVES) + random.random((3, WAVES))
        frequency = low + (high - low) / WAVES * slices
        phase = 2.0 * np.pi * random.random((3, WAVES))
        for axis in range(3):
            waves = np.sin(2.0 * np.pi * np.outer(t, frequency[axis]) + phase[axis])
            omega[:, axis] += strength * rms[axis] * np.sqrt(2.0 / WAVES) * waves.sum(axis=1)
    return GyroLog(t, omega)
