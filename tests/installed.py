"""What the installed extras allow to test."""

from importlib.util import find_spec

from rsdeblur import choices

PRIORS = tuple(prior for prior in choices.PRIORS if prior != "cnn" or find_spec("onnxruntime"))
