from .camera import Camera as Camera
from .config import show_config as show_config
from .errors import ClockError as ClockError
from .errors import CoverageError as CoverageError
from .errors import FileFormatError as FileFormatError
from .errors import GapError as GapError
from .errors import InputError as InputError
from .errors import OutputError as OutputError
from .errors import RsdeblurError as RsdeblurError
from .errors import RsdeblurWarning as RsdeblurWarning
from .exposure import Exposure as Exposure
from .gyro import GyroLog as GyroLog
from .io import read_camera as read_camera
from .io import read_captures as read_captures
from .io import read_gyro as read_gyro
from .motion import BlurPaths as BlurPaths
from .motion import Shot as Shot
from .pipeline import DeblurResult as DeblurResult
from .pipeline import deblur as deblur
from .pipeline import psfs as psfs
from .psf import PsfBank as PsfBank
from .rowblur import RowBlur as RowBlur
from .rowwise import RowDeconvolver as RowDeconvolver
from .simulate import Simulation as Simulation
from .simulate import simulate as simulate
from .wiener import Deconvolver as Deconvolver

__version__: str
