"""Debris before it moves: clumps and their inertia, meshes, random shapes, packings, resting poses."""
