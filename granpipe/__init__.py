"""granpipe: granular flow in axisymmetric vessels as a velocity field for multiphysics programs."""

__version__ = "0.1.0"
