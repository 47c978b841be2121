"""How the scenes of tests begin that are about steel on steel: each adds its own debris, plates and solver."""

STEEL = """\
scene = 1
[materials.steel]
youngs_modulus = "210 GPa"
poisson_ratio = 0.30
density = "7850 kg/m3"
[[pairs]]
between = ["steel", "steel"]
friction = 0.30
restitution = 0.60
"""

HOT_STEEL = STEEL.replace('"7850 kg/m3"\n', '"7850 kg/m3"\nthermal_conductivity = "50 W/m/K"\nheat_capacity = "460 J/kg/K"\n')
"""The same with what `flash_temperature` asks for."""
