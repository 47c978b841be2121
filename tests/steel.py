"""How the scenes of tests begin that are about steel on steel: each adds its own debris, plates and solver."""

from pathlib import Path

SCENES = Path(__file__).parents[1] / "scenes"  # those that are shipped
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


def scene_text(debris, size, upper="", lower="", solver='duration = "1 us"', every="1 us"):
    """A scene of steel; without keys of an upper plate there is none."""
    above = f'[plates.upper]\nmaterial = "steel"\n{upper}\n' if upper else ""
    ends = f'[solver]\n{solver}\n[output]\nevery = "{every}"\n'
    return f'{STEEL}{debris}\n[domain]\nsize = {size}\n[plates.lower]\nmaterial = "steel"\n{lower}\n{above}{ends}'
