"""The scenes of `reference_runs.py`: one base, and what each changes; short, but they use each way through the engine."""

import copy
from typing import Any

Tables = dict[str, Any]

CLUMPS: Tables = {
    "material": "steel", "kind": "irregular", "count": 24, "seed": 3, "spheres": [4, 8], "aspect": [1.0, 0.8, 0.6],
    "size": {"distribution": "lognormal", "median": "10 um", "sigma": 0.2, "min": "5 um", "max": "20 um"},
}  # fmt: skip
ENSEMBLE = CLUMPS | {"count": 600, "spheres": 4, "shapes": 40}
BALLS: Tables = {"material": "steel", "kind": "spheres", "count": 40, "seed": 2, "radius": "3 um"}
FLAKES: Tables = {
    "material": "steel", "kind": "spheres", "count": 12, "seed": 5,
    "shape": [
        {"center": [f"{x} um", f"{y} um", "0 um"], "radius": "2 um"}
        for x, y in ((0, 0), (3, 0), (1.5, 2.598), (-1.5, 2.598), (-3, 0), (-1.5, -2.598), (1.5, -2.598))
    ],
}  # fmt: skip
"""Of one height, so that all carry a common plate."""

BED: Tables = CLUMPS | {"count": 60, "placement": "dense", "solid_fraction": 0.5}
SPOTS: list[Tables] = [
    {"side": "upper", "x": "0.2 um", "z": "2 um", "radius": "2 um"},
    {"side": "lower", "x": "-2 um", "z": "-2 um", "radius": "1 um"},
    {"side": "lower", "x": "1.5 um", "z": "-2 um", "radius": "1.5 um"},
]
PLANAR: Tables = {
    "material": "steel", "kind": "spots", "planar": True, "spots": SPOTS, "mass": "1e-13 kg", "count": 3,
    "inertia": "2e-25 kg m2",
}  # fmt: skip
SHAPES: list[Tables] = [
    {"material": "steel", "kind": "spheroid", "count": 6, "size": "10 um", "axial_ratio": 0.5},
    {"material": "steel", "kind": "spheroid", "count": 4, "size": "10 um", "axial_ratio": 0.6, "form": "oblate"},
    {"material": "steel", "kind": "mesh", "count": 4, "file": "grain.obj", "unit": "1 um", "spheres": 8},
    {"material": "steel", "kind": "file", "count": 4, "file": "grains.csv", "placement": "layer"},
    CLUMPS | {"count": 4, "angularity": 0.5, "asperities": {"radius": "0.5 um"}},
]
FILES = {
    "grain.obj": "v 6 0 0\nv -6 0 0\nv 0 4.5 0\nv 0 -4 0\nv 0 0 3.5\nv 0.5 0 -3\n"
    "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n",
    "grains.csv": "clump,x [um],y [um],z [um],radius [um]\n0,0,0,0,4\n0,4,0,0.5,3\n0,-3,2,0,3\n1,0,30,0,4\n1,3,33,0,3\n",
    "load.csv": "time (us), load (mN)\n0, 0.1\n2, 0.15\n4, 0.05\n",
    "path.csv": "time (us), displacement (um)\n0, 0\n10, 0.1\n20, 0.05\n40, 0.2\n",
}  # files that scenes name, by their names
BASE: Tables = {
    "scene": 1,
    "materials": {"steel": {
        "youngs_modulus": "210 GPa", "poisson_ratio": 0.3, "density": "7850 kg/m3", "yield_strength": "600 MPa",
        "thermal_conductivity": "50 W/m/K", "heat_capacity": "460 J/kg/K",
    }},
    "pairs": [{"between": ["steel", "steel"], "friction": 0.4, "restitution": 0.6}],
    "debris": [CLUMPS],
    "domain": {"size": ["120 um", "90 um"]},
    "plates": {
        "lower": {"material": "steel"},
        "upper": {
            "material": "steel", "support": "load_per_particle", "load": "0.1 mN", "motion": {"x": {"velocity": "10 mm/s"}},
        },
    },
    "contact": {"level": "mindlin", "debris_contact": "none"},
    "solver": {"integrator": "implicit", "distance": "0.6 um", "settle": "5 us"},
    "output": {"every": "0.1 um"},
}  # fmt: skip

UPPER, MOTION, LEVEL, MEET = "plates.upper", "plates.upper.motion", "contact.level", {"contact.debris_contact": "auto"}
EXPLICIT: Tables = {"solver.integrator": "explicit", f"{UPPER}.damping": "7e-5 kg/s", f"{MOTION}.x.velocity": "1 m/s"}
RIGID: Tables = {"debris": [FLAKES], "domain.size": ["60 um", "50 um"], f"{UPPER}.support": "rigid", f"{UPPER}.load": "2 mN"}
NEAR: Tables = MEET | {"domain.size": ["48 um", "40 um"]}
FOUNDATION: Tables = RIGID | {f"{UPPER}.support": "foundation", f"{UPPER}.stiffness": "200 N/m"}
GAP: Tables = RIGID | {f"{UPPER}.load": None, f"{UPPER}.gap": "4.02 um", f"{UPPER}.closing": "1 mm/s"}
SUBMICRON: Tables = {
    "debris": [CLUMPS | {"count": 12, "size": "0.4 um"}], "domain.size": ["4 um", "3 um"], f"{UPPER}.load": "50 nN",
    "solver.settle": "1 us", "solver.distance": "0.1 um", "output.every": "20 nm",
}  # fmt: skip
WAVES: Tables = {
    "wave": [{"amplitude": "0.1 um", "wavelength": "30 um"}, {"amplitude": "0.1 um", "wavelength": "45 um", "direction": "y"}]
}
GROOVES: Tables = {"wave": {"depth": "1 um", "width": "8 um", "flank": "30 deg", "rounding": "0.8 um", "wavelength": "30 um"}}
ROUGH: Tables = {"rms": "0.1 um", "hurst": 0.8, "long": "40 um", "short": "15 um", "seed": 1}
PLANAR_SPOTS: Tables = {"debris": [PLANAR], "domain.size": ["36 um", "8 um"], LEVEL: "exact"}
MAPS: Tables = {"measures": {"cell": "1 um", "wear": {"plates": "1e-15 m3/J", "bodies": "1e-15 m3/J"}, "flash_temperature": True}}
SINE: Tables = {"stroke": "0.4 um", "frequency": "2 kHz"}

SCENES: dict[str, Tables] = {
    "explicit_mindlin_layer": EXPLICIT | MEET | {
        "debris": [CLUMPS | {"count": 700, "shapes": 100}], "domain.size": ["430 um", "400 um"], "solver.settle": "1 us",
        "solver.distance": "0.4 um",
    },
    "explicit_coulomb_shapes": EXPLICIT | MEET | {"debris": SHAPES, LEVEL: "coulomb"},
    "explicit_mdr_rolling": EXPLICIT | MEET | {
        LEVEL: "mdr", "contact.springs": 16,
        "effects": {"rolling_resistance": {"coefficient": 0.05, "damping": 0.3}, "pivoting": {"damping": 0.1}},
    },
    "explicit_exact_spots": EXPLICIT | PLANAR_SPOTS | {f"{MOTION}.x.velocity": "-1 m/s"},
    "implicit_coulomb_shapes": {"debris": SHAPES, LEVEL: "coulomb"},
    "implicit_mindlin_gravity": {"effects": {"gravity": ["0 m/s2", "0 m/s2", "-9.81 m/s2"], "damping": {"rate": "1e4 1/s"}}},
    "implicit_mdr_pivoting": {LEVEL: "mdr", "contact.springs": 16, "effects": {"pivoting": {}}},
    "implicit_exact_spots": PLANAR_SPOTS | {f"{MOTION}.x.velocity": "-10 mm/s"},
    "implicit_rolling_quasistatic": {"solver.inertia": False, "effects": {"rolling_resistance": {"coefficient": 0.05}}},
    "ensemble_mindlin": {"debris": [ENSEMBLE], "domain.size": ["600 um", "500 um"]},
    "ensemble_mdr": {
        "debris": [ENSEMBLE | {"count": 530}], "domain.size": ["600 um", "500 um"], LEVEL: "mdr", "contact.springs": 8,
        "solver.distance": "0.1 um", "output": {"every": "50 nm", "sample": 100, "precision": "float32", "compress": True},
    },
    "islands": MEET | {"debris": [CLUMPS | {"count": 60}], "domain.size": ["130 um", "100 um"]},
    "islands_mdr_stroke": MEET | {
        "debris": [CLUMPS | {"count": 30}], "domain.size": ["90 um", "70 um"], LEVEL: "mdr", "contact.springs": 8,
        f"{MOTION}.x": SINE | {"cycles": 1.5}, "solver.distance": None, "solver.duration": "0.75 ms", "output.every": "50 us",
    },
    "common_plate_rigid": RIGID,
    "common_plate_foundation": FOUNDATION | {f"{UPPER}.preload": "10 uN", f"{MOTION}.y": SINE},
    "common_plate_islands_rigid": RIGID | NEAR,
    "common_plate_islands_foundation": FOUNDATION | NEAR | {f"{UPPER}.load": "1 mN"},
    "explicit_foundation": EXPLICIT | FOUNDATION | NEAR | {"solver.settle": "auto"},
    "explicit_gap_closing": EXPLICIT | GAP | NEAR | {f"{UPPER}.damping": None, f"{UPPER}.closing": "10 mm/s"},
    "implicit_gap_closing": GAP,
    "explicit_relaxed_start": EXPLICIT | MEET | {
        "debris": [BALLS | {"count": 3, "positions": [[f"{x} um", "20 um", "3 um"] for x in (20, 24, 29)]}],
        "solver.initial_overlap": "relax",
    },
    "load_stages": {
        f"{UPPER}.loading": [{"load": "0.2 mN", "duration": "10 us"}, {"pause": "5 us"}, {"load": "0.08 mN"}],
        f"{MOTION}.x": [{"ramp": "10 mm/s", "duration": "10 us"}, {"pause": "5 us"}, {"velocity": "10 mm/s"}],
    },
    "load_table": EXPLICIT | {
        f"{UPPER}.loading": {"table": "load.csv"}, f"{MOTION}.x": {"table": "path.csv", "speed": 10},
        "solver.distance": None, "solver.duration": "4 us", "output.every": "1 us",
    },
    "rough_waves": {"plates.lower.surface": WAVES, f"{UPPER}.surface": GROOVES},
    "rough_direct_contact": EXPLICIT | FOUNDATION | {
        "plates.lower.surface": ROUGH, f"{UPPER}.surface": ROUGH, "plates.contact": {"friction": 0.1}, "solver.settle": "auto",
    },
    "rough_common_plate": RIGID | {
        "plates.lower.surface": ROUGH, "plates.contact": {"beta": 0.4, "u0": "0.3 um", "friction": 0.1}, **MAPS,
    },
    "close_spots": {"effects": {"close_spots": {}}},
    "maps_implicit": MAPS | {f"{MOTION}.x": SINE | {"shape": "triangle"}, "solver.distance": "1 um"},
    "maps_explicit": EXPLICIT | MAPS | MEET,
    "adhesion_jkr": SUBMICRON | MEET | EXPLICIT | {
        f"{UPPER}.damping": None, "effects": {"adhesion": {"work_of_adhesion": "50 mJ/m2", "model": "jkr"}},
    },
    "adhesion_dmt": SUBMICRON | {"effects": {"adhesion": {"work_of_adhesion": "20 mJ/m2", "model": "dmt"}}},
    "elastic_plastic_explicit": EXPLICIT | MEET | {"effects": {"elastic_plastic": {}}},
    "elastic_plastic_implicit": {"effects": {"elastic_plastic": {}}},
    "bed_profiles": EXPLICIT | MEET | {
        "debris": [BED], "domain.size": ["60 um", "45 um"], f"{UPPER}.support": "rigid", f"{UPPER}.load": None,
        f"{UPPER}.pressure": "5 MPa", f"{UPPER}.damping": None, "output.profiles": 12,
        "effects": {"local_damping": {"coefficient": 0.3}},
    },
    "impacts_without_upper_plate": MEET | {
        "debris": [BALLS | {"placement": "dilute", "solid_fraction": 0.2, "velocity": ["1 m/s", "0 m/s", "-2 m/s"]}],
        "domain.size": ["40 um", "40 um"], UPPER: None, "contact": {"law": "hertz_mindlin"}, "solver.integrator": "explicit",
        "solver.distance": None, "solver.settle": "0 us", "solver.duration": "4 us", "output.every": "1 us",
    },
}  # fmt: skip
"""Changes of `BASE` by scene: key by dots -> value, None: the key is left out."""

# changes of `BALANCE` by name; the level is the second word
BALANCES: dict[str, Tables] = {"balance_exact": {}, "balance_mdr": {}, "balance_close_spots": {"effects": {"close_spots": {}}}}

BALANCE: Tables = {
    "balance": 1,
    "materials": {
        name: {"shear_modulus": modulus, "poisson_ratio": ratio}
        for name, modulus, ratio in (("upper", "80 GPa", 0.3), ("lower", "60 GPa", 0.35), ("particle", "120 GPa", 0.2))
    },
    "friction": {"upper": 0.3, "lower": 0.3},
    "particle": {"weight": "0 N", "spots": SPOTS},
    "path": {"indentation": "10 nm", "drag": "12 nm", "steps": 80, "direction": [-1, 0]},
}


def tables_of(changes: Tables) -> Tables:
    tables = copy.deepcopy(BASE)
    for key, value in changes.items():
        *path, last = key.split(".")
        node = tables
        for name in path:
            node = node.setdefault(name, {})
        if value is None:
            node.pop(last, None)
        else:
            node[last] = copy.deepcopy(value)
    return tables
