from . import calibration, deconv, errors, estimate, io, motion, pipeline, plot, report, simulation, tuning
from .burst.burst import deblur_burst as deblur_burst
from .calibration.clip import calibrate as calibrate
from .calibration.photos import calibrate_photos as calibrate_photos
from .config import show_config as show_config
from .deconv.wiener import Deconvolver as Deconvolver
from .errors import CoverageError as CoverageError
from .errors import FileFormatError as FileFormatError
from .errors import InputError as InputError
from .errors import OutputError as OutputError
from .errors import RsdeblurError as RsdeblurError
from .errors import RsdeblurWarning as RsdeblurWarning
from .estimate.correction import Correction as Correction
from .estimate.correction import Uncertainty as Uncertainty
from .estimate.refine import refine as refine
from .estimate.time_offset import find_time_offset as find_time_offset
from .image.transfer import from_linear as from_linear
from .image.transfer import to_linear as to_linear
from .io import read_camera as read_camera
from .io import read_captures as read_captures
from .io import read_gyro as read_gyro
from .io import read_picture as read_picture
from .io import read_trajectory as read_trajectory
from .io import write_picture as write_picture
from .motion.camera import Camera as Camera
from .motion.exposure import Exposure as Exposure
from .motion.gyro import GyroLog as GyroLog
from .motion.translation import Translation as Translation
from .motion.triage import triage as triage
from .pipeline.deblur import deblur as deblur
from .pipeline.deblur import psfs as psfs
from .pipeline.deconvolve import deconvolve as deconvolve
from .pipeline.options import Options as Options
from .pipeline.plan import Plan as Plan
from .pipeline.plan import plan as plan
from .psf import PsfBank as PsfBank
from .simulation.scene import scene as scene
from .simulation.shake import hand_shake as hand_shake
from .simulation.simulate import simulate as simulate
from .simulation.simulate import simulate_clip as simulate_clip

__all__: list[str]
__version__: str
