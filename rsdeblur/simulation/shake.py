"""Model of hand shake, for simulations without a recording."""

import numpy as np

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.motion.gyro import GyroLog

# Low and high edge in Hz, and rms rate in rad/s about x, y and z (z: roll about the optical axis).
BANDS = {
    "drift": (0.1, 2.0, (0.30, 0.26, 0.19)),
    "sway": (3.0, 7.0, (0.72, 0.74, 0.50)),
    "tremor": (8.0, 12.0, (0.61, 0.72, 0.27)),
}
# Sinusoids per band and axis: the sum of 32 looks Gaussian and does not repeat.
WAVES = 32
# Most samples of a simulated log: three hours at 200 Hz.
MOST_SAMPLES = 2_000_000


def hand_shake(duration: float, *, rate: float = 200.0, strength: float = 1.0, seed: int = 0) -> GyroLog:
    """Return the simulated gyro log of a phone in a shaking hand.

    The rate about each axis is the sum of three bands of noise: slow *drift* of the body (0.1 to 2 Hz), *sway* of the
    arm with the mass that it holds (3 to 7 Hz), and the physiological *tremor* of the hand (8 to 12 Hz). Each band is a
    sum of sinusoids whose frequencies and phases depend on `seed` only, so another duration or sampling rate gives
    samples of the same motion.

    Parameters
    ----------
    duration : float
        Length in s, positive. Samples cover [0, duration].
    rate : float, default 200.0
        Sampling rate in Hz, above 24 Hz, which is twice the highest frequency of the tremor.
    strength : float, default 1.0
        Factor on all rates, at least 0. At 1, each band has the rms of a real recording of a phone shaken on purpose
        (57 s at 210 Hz; 1.0, 1.1 and 0.6 rad/s rms about x, y and z). About 0.03 is a steady hold.
    seed : int, default 0
        Seed of the motion, at least 0.

    Returns
    -------
    GyroLog
        Log with times from 0 s and epoch 0. Its axes are camera axes: z is the viewing direction.

    Raises
    ------
    InputError
        If an argument is out of its range.

    Notes
    -----
    Physiological hand tremor peaks between 6 and 12 Hz [1]_; an arm that holds a phone swings at a few Hz [2]_. The
    strength of a steady hold follows from a photographers' rule: with an exposure of 1/f s (f in mm, 35 mm film), blur
    stays near 1/30 mm.

    References
    ----------
    .. [1] M. Lakie et al., "Increased gravitational force reveals the mechanical, resonant nature of physiological
       tremor", J. Physiol. 593 (2015) 4411-4422.
    .. [2] R. J. Elble, "Physiologic and enhanced physiologic tremor", in M. Hallett (ed.), Movement Disorders,
       Handbook of Clinical Neurophysiology 1 (2003), chapter 22.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.hand_shake(0.5, seed=1)
    GyroLog(t=float64[101], rate=200, span=(0, 0.5), epoch_ns=0)
    """
    duration = validate.finite("duration", duration, above=0.0)
    rate = validate.finite("rate", rate, above=2.0 * BANDS["tremor"][1])
    strength = validate.finite("strength", strength, minimum=0.0, maximum=1e9)  # GyroLog accepts such rates
    if duration * rate > MOST_SAMPLES:
        raise InputError(
            f"duration times rate must be at most {MOST_SAMPLES} samples, got {duration:g} s at {rate:g} Hz"
        )
    random = np.random.default_rng(validate.count("seed", seed, minimum=0))
    t = np.arange(np.ceil(duration * rate) + 1.0) / rate
    omega = np.zeros((len(t), 3))
    for low, high, rms in BANDS.values():
        # One frequency from each of WAVES equal slices, so that the waves cover the whole band.
        slices = np.arange(WAVES) + random.random((3, WAVES))
        frequency = low + (high - low) / WAVES * slices
        phase = 2.0 * np.pi * random.random((3, WAVES))
        for axis in range(3):
            waves = np.sin(2.0 * np.pi * np.outer(t, frequency[axis]) + phase[axis])
            omega[:, axis] += strength * rms[axis] * np.sqrt(2.0 / WAVES) * waves.sum(axis=1)
    return GyroLog(t, omega)
