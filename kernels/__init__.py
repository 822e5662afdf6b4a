"""Kernels in twins: one concept a file, ``NAME.py`` for Warp and ``NAME.cl`` for OpenCL, with the same signatures."""
