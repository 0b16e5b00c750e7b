"""The orientation of the camera, integrated from a gyro log."""

from __future__ import annotations

from dataclasses import dataclass

from rsdeblur._util.one_line import one_line
from rsdeblur.errors import InputError
from rsdeblur.kernels.poses import integrated, orientations
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import GyroLog, samples_around
from rsdeblur.types import FloatArray

# Most samples of a recording of one or several exposures: 80 minutes at 200 Hz, 2 minutes at 8 kHz.
MOST_SAMPLES = 1_000_000


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class OrientationTrack:
    """Camera orientation `C(t)`, camera-from-world, between the samples of a gyro log: `dC/dt = -[omega]x C`.

    Rates are interpolated linearly between samples. Each step is the rotation of the fourth-order Magnus expansion, so
    `C` stays a rotation, and a constant rate is integrated without error.
    """

    t: FloatArray  # (n,), s, camera time
    omega: FloatArray  # (n, 3), rad/s, camera axes
    rotations: FloatArray  # (n, 3, 3), C(t[i]); the first is the identity

    @classmethod
    def from_log(cls, log: GyroLog, camera: Camera, t0: float, t1: float, epoch_ns: int) -> OrientationTrack:
        """Return the track from the last sample before `t0` to the first after `t1`, camera time, s after `epoch_ns`.

        Raise `InputError` if there are more than `MOST_SAMPLES`, and the errors of :meth:`GyroLog.covering`.
        """
        # camera_time = gyro_time + time_offset
        log = log.covering(t0 - camera.time_offset, t1 - camera.time_offset, epoch_ns)
        if len(log) > MOST_SAMPLES:
            raise InputError(
                f"the span from {t0:g} s to {t1:g} s has {len(log)} gyro samples, more than {MOST_SAMPLES}; are the "
                "duration of the exposure and the readout time in s?"
            )
        return cls.integrated(log.t + camera.time_offset, log.omega @ camera.imu_to_camera.T)

    @classmethod
    def integrated(cls, t: FloatArray, omega: FloatArray) -> OrientationTrack:
        """Return the track of rates in camera axes at increasing times, over gaps as well."""
        return cls(t, omega, integrated(t, omega))

    def during(self, t0: float, t1: float) -> OrientationTrack:
        """Return the part from the last sample at or before `t0` to the first at or after `t1`."""
        part = samples_around(self.t, t0, t1)
        return OrientationTrack(self.t[part], self.omega[part], self.rotations[part])

    def at(self, times: FloatArray) -> FloatArray:
        """Return the matrices `C`, ``times.shape + (3, 3)``, at times within the track, s."""
        return orientations(times, self.t, self.omega, self.rotations)

    def angles(self, times: FloatArray) -> FloatArray:
        """Return the integrals of the rates since the first sample, rad, (..., 3): rotations by small angles."""
        from scipy.interpolate import make_interp_spline  # takes 0.3 s to import; only small angles need it

        return make_interp_spline(self.t, self.omega, k=1).antiderivative()(times)
