"""The scene of four balls that tests play with and spoil."""

from steel import STEEL

PLATES = """\
[plates.lower]
material = "steel"
[plates.upper]
material = "steel"
support = "load_per_particle"
load = "0.1 mN"
damping = "7e-5 kg/s"
motion = {x = {velocity = "0.5 m/s"}}
"""
BALLS = f"""title = "four balls"
{STEEL}[[debris]]
material = "steel"
kind = "spheres"
radius = "5 um"
count = 4
seed = 1
[domain]
size = ["80 um", "60 um"]
{PLATES}[solver]
distance = "0.1 um"
settle = "1 us"
[output]
every = "0.05 um"
"""


def edited(text: str, *changes: tuple[str, str]) -> str:
    """Return a text with the first place of each old text replaced by the new one; every old text must be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text
