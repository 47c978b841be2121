"""Template of the scene that `thirdbody new` writes."""

TEMPLATE = """# How does a small layer of irregular steel debris move between two sheared steel plates?
# Expect most particles to stick while they are pressed, then to slide or to roll once the drag begins.
scene = 1
title = "steel debris between steel plates"

[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.30
density = "7850 kg/m3"

[[pairs]]
between = ["steel", "steel"]
friction = 0.30
restitution = 0.60

[[debris]]
material = "steel"
kind = "irregular"
count = 100
seed = 1
size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}
spheres = [4, 8]
aspect = [1.0, 0.8, 0.6]
placement = "layer"

[domain]
size = ["240 um", "180 um"]

[plates.lower]
material = "steel"

[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
damping = "7e-5 kg/s"
motion = {x = {velocity = "1 m/s"}}

[solver]
distance = "5 um"

[output]
every = "0.5 um"
"""
