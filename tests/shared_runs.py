"""Scenes whose runs many tests read: `shared_run("layer")` (conftest) runs each once in a session, for all its processes."""

import balls
from steel import HOT_STEEL, STEEL

CLUMPS = """\
[[debris]]
material = "steel"
kind = "irregular"
count = COUNT
size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}
spheres = [4, 8]
aspect = [1.0, 0.8, 0.6]
"""
PLATES = balls.PLATES.replace('damping = "7e-5 kg/s"\n', "").replace("0.5 m/s", "10 mm/s")
PATH = '[solver]\ndistance = "0.4 um"\n[output]\nevery = "0.1 um"\n'
WAVES = '{rms = "0.2 um", hurst = 0.8, long = "40 um", short = "20 um", seed = 3}'
STROKE = 'motion = {x = {stroke = "0.4 um", frequency = "50 Hz"}}'


def clumps(count: int, area: str, material: str = STEEL) -> str:
    return material + CLUMPS.replace("COUNT", str(count)) + f"[domain]\nsize = {area}\n"


SHARED = {
    # clumps that meet: implicit, islands; labels and forecasts, contacts between bodies
    "layer": clumps(40, '["150 um", "120 um"]') + PLATES + PATH.replace("]\n", ']\nintegrator = "implicit"\n', 1),
    # an ensemble with maps of wear and flash temperatures
    "alone": clumps(520, '["800 um", "600 um"]', HOT_STEEL) + PLATES
    + '[contact]\ndebris_contact = "none"\n[measures]\ncell = "4 um"\nflash_temperature = true\n'
    'wear = {law = "archard", plates = "1e-15 m3/J", bodies = "1e-15 m3/J"}\n'
    + PATH,
    # a dense bed of spheres with profiles: explicit
    "bed": STEEL + '[[debris]]\nmaterial = "steel"\nkind = "spheres"\ncount = 200\nplacement = "dense"\n'
    'radius = "4 um"\n'
    '[domain]\nsize = ["48 um", "40 um"]\n'
    '[plates.lower]\nmaterial = "steel"\n[plates.upper]\nmaterial = "steel"\nsupport = "rigid"\npressure = "10 MPa"\n'
    'motion = {x = {velocity = "20 m/s"}}\n'
    '[solver]\nsettle = "0.2 us"\ndistance = "4 um"\n[output]\nevery = "0.5 um"\nprofiles = 20\n',
    # two cycles of a fretting loop
    "stroke": clumps(20, '["160 um", "120 um"]') + PLATES.replace('motion = {x = {velocity = "10 mm/s"}}', STROKE)
    + '[contact]\ndebris_contact = "none"\n[solver]\nduration = "40 ms"\n[output]\nevery = "0.1 um"\n',
    # patches on springs, and plates that also meet each other
    "plate": clumps(30, '["160 um", "120 um"]')
    + PLATES.replace('"load_per_particle"\nload = "0.1 mN"', '"foundation"\nstiffness = "1e4 N/m"\nload = "3 mN"')
    + '[plates.contact]\nbeta = 0.1\nu0 = "0.8 um"\nfriction = 0.1\n'
    + PATH.replace("]\n", ']\nintegrator = "implicit"\n', 1),
    # balls between wavy plates
    "rough": STEEL + '[[debris]]\nmaterial = "steel"\nkind = "spheres"\ncount = 8\n'
    'radius = "5 um"\n'
    '[domain]\nsize = ["80 um", "60 um"]\n'
    + PLATES.replace('material = "steel"\n', f'material = "steel"\nsurface = {WAVES}\n')
    + '[contact]\ndebris_contact = "none"\n' + PATH,
}  # fmt: skip
