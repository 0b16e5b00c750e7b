from .simulate import Layer as Layer
from .simulate import Simulation as Simulation

__all__: list[str]
