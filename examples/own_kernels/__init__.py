"""Kernels of one's own, in twins: ``ultrasound.py`` for Warp, ``ultrasound.cl`` for OpenCL."""
