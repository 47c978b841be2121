"""Surfaces of first bodies as heights on a periodic grid: random, waves, measured; their statistics."""
