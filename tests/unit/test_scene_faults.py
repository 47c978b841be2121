"""Every fault of a scene file is told once, with its place, and with all others; what is too large is told by its counts."""

from pathlib import Path

import numpy as np
import pytest
from each import each
from steel import STEEL
from thirdbody.assembly.schedule import rows_of
from thirdbody.assembly.simulation import build
from thirdbody.bodies.body_tables import load_bodies
from thirdbody.errors import InputError
from thirdbody.scene.model import Scene, Spheres

GOOD = (Path(__file__).parent / "good_scene.toml").read_text(encoding="utf-8")
BEFORE_DEBRIS, AFTER_DEBRIS = GOOD[: GOOD.index("[[debris]]")], GOOD[GOOD.index("[domain]") :]
PAIR = '[[pairs]]\nbetween = ["steel", "steel"]\nfriction = 0.30\nrestitution = 0.60\n'
SIZE = 'size = {distribution = "lognormal", median = "10 um", sigma = 0.2, min = "5 um", max = "20 um"}'


def changed(*changes: tuple[str, str]) -> str:
    text = GOOD
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return text


def faults_of(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        Scene.parse(text, "x.toml")
    return [str(fault).removeprefix("x.toml:") for fault in caught.value.faults]


# one change, the one fault that must be told
ONE_FAULT = [
    # misspelt keys, at every depth, with nothing else told
    ("title =", "titel =", "2:1: titel: unknown key, did you mean 'title'?"),
    ("youngs_modulus", "young_modulus", "4:1: materials.steel.young_modulus: unknown key, did you mean 'youngs_modulus'?"),
    ("friction", "frictoin", "9:1: pairs[0].frictoin: unknown key, did you mean 'friction'?"),
    ("median =", "mdian =", "16:37: debris[0].size.mdian: unknown key, did you mean 'median'?"),
    ("velocity =", "velocty =", "28:16: plates.upper.motion.x.velocty: unknown key, did you mean 'velocity'?"),
    ("every =", "evry =", "42:1: output.evry: unknown key, did you mean 'every'?"),
    ('["600 um", "400 um"]', '["6 um", "4 um"]\nz = 1', "22:1: domain.z: unknown key, known: ends, periodic, size, walls"),
    # missing keys
    ("scene = 1\n", "", "1:1: scene: required key is missing: write scene = 1"),
    ("poisson_ratio = 0.30\n", "", "3:1: materials.steel.poisson_ratio: required key is missing"),
    ('kind = "irregular"\n', "",
     "11:1: debris[0].kind: required key is missing: one of 'irregular', 'spheres', 'mesh', 'spots', 'file', 'spheroid'"),
    ('[output]\nevery = "0.5 um"\n', "", "1:1: output: required key is missing"),
    ('load = "0.1 mN"\n', "", "24:1: plates.upper: give one of load, pressure, gap"),
    ('youngs_modulus = "210 GPa"\n', "", "3:1: materials.steel: give one of youngs_modulus, shear_modulus"),
    # units
    ('"210 GPa"', '"210 um"', "4:1: materials.steel.youngs_modulus: '210 um' is a length, expected a pressure"),
    ('"400 um"]', "400]", "21:19: domain.size[1]: 400 has no unit, expected a unit of length (pm, nm, um, mm, m, angstrom)"),
    (SIZE, 'size = "3 N"', "16:1: debris[0].size: '3 N' is a force, expected a length"),
    ('time_step = "auto"', 'time_step = "1 um"', "38:1: solver.time_step: '1 um' is a length, expected a time or 'auto'"),
    ('"0.5 um"', "0.5",
     "42:1: output.every: 0.5 has no unit, expected a unit of length (pm, nm, um, mm, m, angstrom) "
     "or time (ps, ns, us, ms, s, min, h)"),
    ('"0.5 um"', '"5 us"\nevery_kind = "time"',
     "43:1: output.every_kind: unknown key: the unit of every says whether it is a length or a time"),
    # ranges
    ('"5 um"', '"-5 um"', "16:68: debris[0].size.min: '-5 um' must be greater than 0"),
    ('"5 um"', '"50 um"', "16:68: debris[0].size.min: min must be less than max"),
    ("count = 2000", "count = 20.0", "14:1: debris[0].count: expected a whole number, got 20.0"),
    ("seed = 1", "seed = true", "15:1: debris[0].seed: expected a whole number, got true"),
    ("= 0.30\ndensity", "= 0.7\ndensity", "5:1: materials.steel.poisson_ratio: 0.7 must be greater than -1 and at most 0.5"),
    ("restitution = 0.60", "restitution = 0.0", "10:1: pairs[0].restitution: 0.0 must be at least 1e-06 and at most 1"),
    ("friction = 0.30", "friction = nan", "9:1: pairs[0].friction: nan is not a finite number"),
    ('"1 m/s"', '"1 m/s", through = "0 N/m"', "28:36: plates.upper.motion.x.through: '0 N/m' must be greater than 0"),
    ('{velocity = "1 m/s"}', '[{pause = "1 us"}, {velocity = "1 m/s", through = "1 N/m"}]',
     "28:55: plates.upper.motion.x[1].through: belongs to the first stage: the spring is that of the whole axis"),
    ('"1 m/s"', "inf", "28:16: plates.upper.motion.x.velocity: inf is not a finite number"),
    ("[4, 8]", "[8, 4]", "17:1: debris[0].spheres: the least, 8, is more than the most, 4"),
    ("[4, 8]", '[4, 8]\nshapes = 9\nasperities = {radius = "1 um"}',
     "19:15: debris[0].asperities.radius: with shapes = 9, whose copies have other sizes, "
     "it must be a fraction of the body's radius"),
    ("[1.0, 0.8, 0.6]", "[1.0, 0.8]", "18:1: debris[0].aspect: expected a list of 3 values, got 2 of them"),
    ("scene = 1", "scene = 2", "1:1: scene: 2 must be 1"),
    # types
    ("[[debris]]", "[debris]", "11:1: debris: expected a list of tables [[debris]], got a table"),
    ('"400 um"]', '"400 um"]\nperiodic = "yes"', "22:1: domain.periodic: expected true or false, got 'yes'"),
    ('["0 m/s2", "0 m/s2", "-9.81 m/s2"]', '"9.81 m/s2"', "35:1: effects.gravity: expected a list of 3 values, got '9.81 m/s2'"),
    # choices
    ('"irregular"', '"irregulr"',
     "13:1: debris[0].kind: 'irregulr' is not one of 'irregular', 'spheres', 'mesh', 'spots', 'file', 'spheroid'; one in a file "
     "needs --plugin FILE (in Python plugins=[FILE])"),
    ('"load_per_particle"', '"foo"',
     "26:1: plates.upper.support: 'foo' is not one of 'rigid', 'foundation', 'load_per_particle'"),
    # known to the file format, but not yet
    ('"layer"', '"heap"', "19:1: debris[0].placement: 'heap' is not one of 'layer', 'dilute', 'dense'"),
    ('"load_per_particle"', '"foundation"',
     "24:1: plates.upper.stiffness: required key is missing: the stiffness of each particle's patch, such as \"1e4 N/m\""),
    ('load = "0.1 mN"', 'load = "0.1 mN"; closing = "1 um/s"'.replace("; ", "\n"),
     "28:1: plates.upper.closing: needs a gap to start from"),
    ('{velocity = "1 m/s"}', '{ramp = "1 m/s2", duration = "1 us"}',
     "28:16: plates.upper.motion.x.ramp: '1 m/s2' is an acceleration, expected a velocity"),
    # keys that exclude each other
    ('load = "0.1 mN"', 'load = "0.1 mN"\ngap = "5 um"',
     "28:1: plates.upper.gap: give only one of load, pressure, gap: load is given too"),
    ('load = "0.1 mN"', 'gap = "5 um"', "27:1: plates.upper.gap: support = 'load_per_particle' takes a load, not a gap"),
    ('load = "0.1 mN"', 'load = "0.1 mN"\npreload = "1 uN"', "28:1: plates.upper.preload: belongs to support = 'foundation'"),
    ('distance = "20 um"', 'distance = "20 um"\nduration = "1 s"',
     "40:1: solver.duration: give only one of distance, duration: distance is given too"),
    ('[plates.lower]\nmaterial = "steel"\n', "", "22:1: plates.upper: an upper plate needs a lower one: add [plates.lower]"),
    # between tables
    ('between = ["steel", "steel"]', 'between = ["steel", "stel"]',
     "8:21: pairs[0].between[1]: unknown material 'stel', did you mean 'steel'?"),
    ('[plates.lower]\nmaterial = "steel"', '[plates.lower]\nmaterial = "brass"',
     "23:1: plates.lower.material: unknown material 'brass', known: steel"),
    (PAIR, PAIR + PAIR, "12:1: pairs[1].between: 'steel' and 'steel' are given by pairs[0] already"),
    (PAIR, "",
     "1:1: pairs: no pair for 'steel' and 'steel', which can meet (debris[0] and plates.lower): "
     'add a [[pairs]] table with between = ["steel", "steel"]'),
    ('"0.5 um"', '"1 ns"', '"1 m/s"', '"0 m/s"',
     "39:1: solver.distance: a distance needs an upper plate that moves: add plates.upper.motion, or give duration instead"),
    ('distance = "20 um"', 'duration = "1 us"', '"1 m/s"', '"0 m/s"',
     "42:1: output.every: a length of sliding needs an upper plate that moves: add plates.upper.motion, or give a time"),
    # not TOML
    ('"20 um"\ninit', '"20 um" x\ninit', "39:20: not valid TOML: Expected newline or end of document after a statement"),
    ('"0.5 um"\n', "[1,", "42:12: not valid TOML: Invalid value"),
]  # fmt: skip


@each(ONE_FAULT, name_of=lambda row: row[-1])
def test_one_fault_is_reported_once_and_in_its_place(row):
    *texts, message = row
    assert faults_of(changed(*zip(texts[::2], texts[1::2], strict=True))) == [message]


def test_all_faults_are_reported_at_once_in_the_order_of_the_file():
    text = changed(
        ("youngs_modulus", "young_modulus"), ("count = 2000", "count = 0"), ('median = "10 um"', 'median = "10 MPa"'),
        ('gravity = ["0 m/s2", "0', 'gravity = [0, "0'), (PAIR, ""),
    )  # fmt: skip
    assert [fault.split(": ")[1] for fault in faults_of(text)] == [
        "pairs", "materials.steel.young_modulus", "debris[0].count", "debris[0].size.median", "effects.gravity[0]",
    ]  # fmt: skip
    # what drives planar spots out of their plane
    spots = Scene.load(Path(__file__).parents[2] / "scenes" / "three_spot.toml")
    across = {"effects.gravity": ["0 m/s2", "-9.81 m/s2", "0 m/s2"], "plates.upper.motion.y": {"velocity": "1 m/s"}}
    with pytest.raises(InputError) as caught:
        spots.with_settings(across)
    assert {fault.key for fault in caught.value.faults} == {"effects.gravity[1]", "plates.upper.motion.y"}
    # no debris and an empty file
    for text in ("debris = []", ""):
        found = faults_of(text + "\n" + BEFORE_DEBRIS + AFTER_DEBRIS)
        assert [fault.partition(": ")[2] for fault in found] == ["debris: at least one [[debris]] table is needed"]
    # all that is missing
    assert {fault.split(": ")[1] for fault in faults_of("")} == {"scene", "materials", "debris", "domain", "solver", "output"}


def balls(lines: str) -> str:
    return f'{BEFORE_DEBRIS}[[debris]]\nkind = "spheres"\nmaterial = "steel"\n{lines}\n{AFTER_DEBRIS}'


def test_every_two_tables_whose_bodies_can_meet_need_a_pair():
    debris = '[[debris]]\nkind = "spheres"\nradius = "5 um"\ncount = 1\nmaterial = '
    more = '[materials.{}]\nyoungs_modulus = "1 GPa"\npoisson_ratio = 0.3\ndensity = "8000 kg/m3"\n'
    tables = "".join(f'{debris}"{name}"\n' for name in ("brass", "steel", "iron"))
    found = faults_of(BEFORE_DEBRIS + more.format("brass") + more.format("iron") + tables + AFTER_DEBRIS)
    first, last, both = "debris[0] and plates.lower", "debris[2] and plates.lower", "debris[0] and debris[2]"
    assert sorted(fault.split("(")[1].split(")")[0] for fault in found) == sorted((first, last, both))


def test_spheres_at_positions_and_of_one_shape_in_a_layer():
    points = '[["0 m", "0 m", "5 um"], ["20 um", "0 m", "5 um"]]'
    (debris,) = Scene.parse(balls(f'radius = "5 um"\npositions = {points}\norientation = [2, 0, 0, 0]')).debris
    assert isinstance(debris, Spheres)
    assert (debris.count, debris.placement, debris.orientation) == (2, None, (1.0, 0.0, 0.0, 0.0))
    assert debris.positions == ((0.0, 0.0, 5e-6), (20e-6, 0.0, 5e-6))
    shape = '[{radius = "5 um"}, {center = ["4 um", "0 m", "0 m"], radius = "3 um"}]'
    (debris,) = Scene.parse(balls(f"shape = {shape}\ncount = 7")).debris
    assert isinstance(debris, Spheres) and debris.shape is not None
    assert (debris.count, debris.placement) == (7, "layer")
    assert [ball.center[0] for ball in debris.shape] == [0.0, 4e-6]


POINT = '"1 um"\npositions = [["0 m", "0 m", "0 m"]]'
FAULTS_OF_SPHERES = [
    ("count = 1", "11:1: debris[0]: give one of radius, shape"),
    ('radius = "1 um"', "11:1: debris[0].count: required key is missing: give count, or positions"),
    ('shape = [{radius = "1 um"},\n  {center = ["0 m", "x", "0 m"], radius = "1 um"}]\ncount = 1',
     "15:21: debris[0].shape[1].center[1]: cannot read 'x' as a length: write for example \"10 um\""),
    (f"count = 3\nradius = {POINT}", "14:1: debris[0].count: 3 is not the number of positions, 1"),
    (f"radius = {POINT}\norientation = [0, 0, 0, 0]",
     "16:1: debris[0].orientation: a quaternion (w, x, y, z) of length zero is no orientation"),
    ('radius = "1 um"\ncount = 1\norientation = [1, 0, 0, 0]',
     "16:1: debris[0].orientation: needs positions: a placement chooses the pose of each body"),
]  # fmt: skip


@each(FAULTS_OF_SPHERES, name_of=lambda row: row[-1])
def test_faults_of_spheres(row):
    assert faults_of(balls(row[0])) == [row[1]]


BRASS = '[materials.brass]\nshear_modulus = "40 GPa"\npoisson_ratio = 0.3\ndensity = "8400 kg/m3"\n'


def missing_pairs(debris: str, contact: str = "auto") -> set[str]:
    """Who lacks a pair, for brass debris between steel plates of which only the steel pair is given."""
    text = BEFORE_DEBRIS + BRASS + debris + AFTER_DEBRIS.replace('debris_contact = "auto"', f'debris_contact = "{contact}"')
    return {fault.split("(")[1].split(")")[0] for fault in faults_of(text)}


def ball(material: str, count: int) -> str:
    return f'[[debris]]\nkind = "spheres"\nmaterial = "{material}"\nradius = "1 um"\ncount = {count}\n'


WEAR = ("[plates.upper]", "[plates.wear]\ncycles = 1\ntimes = 10\n[plates.upper]")
MAPPED = ("[solver]", '[measures]\ncell = "1 um"\nwear = {plates = "1e-15 m3/J"}\n[solver]')
FAULTS_OF_WEAR = [
    ([WEAR], "24:1: plates.wear: takes what measures.wear has mapped: add it, and measures.cell"),
    ([WEAR, MAPPED, ("cycles = 1", "")], "24:1: plates.wear: give one of cycles, distance"),
    ([WEAR, MAPPED, ("cycles = 1", 'distance = "1 um"\ncycles = 1')],
     "25:1: plates.wear.distance: give only one of cycles, distance: cycles is given too"),
    ([WEAR, MAPPED, ("times = 10", "times = 0")], "26:1: plates.wear.times: 0 must be greater than 0"),
    ([WEAR, MAPPED, ('["600 um", "400 um"]', '["600 um", "400 um"]\nperiodic = false')],
     "25:1: plates.wear: worn surfaces repeat with the domain: domain.periodic must be true"),
    ([WEAR, MAPPED, ('"refuse"', '"relax"')],
     "46:1: solver.initial_overlap: 'relax' pushes bodies apart between flat plates only, and plates.wear has heights; "
     'give positions without overlap, or placement = "layer"'),
]  # fmt: skip


@each(FAULTS_OF_WEAR, name_of=lambda row: row[-1])
def test_faults_of_wear_that_changes_the_plates(row):
    changes, fault = row
    assert faults_of(changed(*changes)) == [fault]


def test_cycles_need_a_motion_that_comes_back():
    with pytest.raises(InputError, match="plates.wear.cycles: the motion of the upper plate does not come back: give distance"):
        build(Scene.parse(changed(WEAR, MAPPED)))


def test_pairs_are_needed_only_where_materials_can_meet():
    plate = "debris[0] and plates.lower"
    assert missing_pairs(ball("brass", 5)) == {plate, "the bodies of debris[0]"}
    assert missing_pairs(ball("brass", 5), "none") == {plate}
    assert missing_pairs(ball("brass", 1)) == {plate}  # one body meets no other
    # the brass-steel pair of the plate also serves the two populations
    assert missing_pairs(ball("brass", 1) + ball("steel", 1)) == {plate}
    assert missing_pairs(ball("brass", 1) + ball("brass", 1)) == {plate, "debris[0] and debris[1]"}


TAIL = """
[domain]\nsize = ["80 um", "60 um"]\n[plates.lower]\nmaterial = "steel"
[solver]\nduration = "2 us"\n[output]\nevery = "0.5 us"\n"""
BALL = '[[debris]]\nkind = "spheres"\nmaterial = "steel"\nradius = "1 um"\ncount = 1\n'


def test_tables_of_too_many_rows_are_refused_and_faults_by_the_thousand_counted(tmp_path):
    n = 1_000_001
    np.savez_compressed(tmp_path / "b.npz", center=np.zeros((n, 3)), radius=np.zeros(n), clump=np.zeros(n, int))
    with pytest.raises(InputError, match="center: has 1000001 rows, at most 1000000 spheres are read from one file"):
        load_bodies(tmp_path / "b.npz")
    (tmp_path / "b.csv").write_bytes(b"clump,x [um],y [um],z [um],radius [um]\n" + b"1,1,1,1,1\n" * 1_000_001)
    with pytest.raises(InputError, match="b.csv: has 1000001 rows, at most 1000000 spheres are read from one file"):
        load_bodies(tmp_path / "b.csv")
    (tmp_path / "m.csv").write_bytes(b"time (us), displacement (um)\n" + b"1,1\n" * 1_000_000)
    scene = Scene.parse(STEEL + BALL + TAIL, folder=tmp_path)
    with pytest.raises(InputError, match="is too large: at most 1000000 rows and 100 MB are read"):
        rows_of(scene, ("plates", "upper", "motion", "x", "table"), "m.csv", "displacement", "length")
    n = 5000
    np.savez(tmp_path / "b.npz", center=np.full((n, 3), np.nan), radius=np.zeros(n), clump=np.zeros(n, int))
    with pytest.raises(InputError) as report:
        load_bodies(tmp_path / "b.npz")
    assert len(report.value.faults) == 11 and report.value.faults[-1].message == "and 19990 more faults"
    for head, debris, message in (
        (STEEL + "".join(f"[materials.m{k}]\n" for k in range(1000)), BALL, "materials: 1001 materials, at most 1000 are read"),
        (STEEL, BALL * 1001, "debris: 1001 debris tables, at most 1000 are read"),
    ):
        with pytest.raises(InputError) as report:
            Scene.parse(head + debris + TAIL)
        assert len(report.value.faults) == 1 and message in str(report.value)
    assert len(Scene.parse(STEEL + BALL * 1000 + TAIL).debris) == 1000
