"""Kernels of the explicit integrator (velocity Verlet)."""
