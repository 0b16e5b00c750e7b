from .simulate import Simulation as Simulation

__all__: list[str]
