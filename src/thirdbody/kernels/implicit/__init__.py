"""Kernels of the implicit integrator (BDF2 with Newton's method)."""
