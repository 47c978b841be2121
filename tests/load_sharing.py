"""Friction and shares of the load over the pressure on rough plates: `python tests/load_sharing.py SWEEP -o PICTURE`.

SWEEP is a finished sweep of scenes/sweeps/friction_against_pressure.toml, drawn over an estimate in closed form. A body of
height h where the surfaces reach z into the gap is pressed where h + z exceeds the mean gap u, by a spring k for each (contacts
are taken as stiff). With h + z normally distributed (Greenwood and Williamson 1966, springs for Hertz), n bodies per area carry
p_debris = n k s (phi(t) - t Q(t)), active = Q(t), t = (u - mean of h)/s, s^2 = spread of h^2 + rms^2 of both surfaces, and the
plates themselves p_direct = beta E* exp(-u/u0) (Persson 2007). Friction is mixed by the shares of the load."""

import argparse
import math
from collections import namedtuple
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
import thirdbody
from thirdbody.assembly.physics import compile_physics
from thirdbody.assembly.plate_load import direct_contact
from thirdbody.assembly.populate import populate, sphere_centres
from thirdbody.assembly.surfaces import plate_surfaces
from thirdbody.laws.registry import discover
from thirdbody.palette import INK, LINE_COLORS

PRESSURE, ROUGHNESS, COUNT = "plates.upper.pressure", "plates.lower.surface.rms", "debris.0.count"
ALONE = 0.99  # share of the load from which on debris is said to carry all of it


class Sharing(NamedTuple):
    """Debris and plates that share a load: bodies per area [1/m2], springs [N/m], heights [m], direct contact."""

    density: float
    spring: float
    height: float
    spread: float
    prefactor: float  # pressure of direct contact at zero gap [Pa]
    length: float  # u_0 [m]

    def pressures(self, gap: float) -> tuple[float, float, float]:
        """Return the pressures on debris and of direct contact [Pa] at a mean gap [m], and the fraction of bodies that carry."""
        t = (gap - self.height) / self.spread
        above = 0.5 * math.erfc(t / math.sqrt(2.0))
        excess = math.exp(-0.5 * t * t) / math.sqrt(2.0 * math.pi) - t * above
        return self.density * self.spring * self.spread * excess, self.prefactor * math.exp(-gap / self.length), above

    def at(self, pressure: float) -> tuple[float, float]:
        """Return the share of debris and the fraction of active bodies at a pressure [Pa] below `prefactor`."""
        high = max(self.height + 10.0 * self.spread, self.length * (1.0 + math.log(self.prefactor / pressure)))
        gap = brentq(lambda u: sum(self.pressures(u)[:2]) - pressure, 0.0, high, xtol=1e-12)
        debris, direct, active = self.pressures(gap)
        return debris / (debris + direct), active


def estimate(scene: thirdbody.Scene) -> Sharing:
    """Heights are those of the bodies of a scene in their resting poses on a flat plate."""
    area = scene.domain.size[0] * scene.domain.size[1]
    direct = direct_contact(scene, compile_physics(scene, discover()), plate_surfaces(scene))
    upper, lower = scene.plates.upper, scene.plates.lower
    centres, radii, body = sphere_centres(populate(scene, [], {}))
    heights = np.array([np.max((centres[:, 2] + radii)[body == k]) for k in range(body.max() + 1)])
    spread = math.hypot(float(heights.std()), upper.surface.rms, lower.surface.rms)
    mean, prefactor = float(heights.mean()), direct.prefactor / area
    return Sharing(len(heights) / area, upper.stiffness, mean, spread, prefactor, direct.length)


Point = namedtuple("Point", "pressure friction share active")
"""A point of the sweep: pressure [Pa], friction, share of the load on debris, fraction of active bodies."""

Series = dict[tuple[float, int], list[Point]]  # points by roughness [m] and number of bodies, in the order of the pressure


def read_sweep(folder: Path) -> Series:
    table = thirdbody.Sweep(folder).to_pandas()
    assert (table["status"] == "done").all()
    columns = [PRESSURE, "friction_coefficient", "load_share_debris", "active"]
    groups = table.sort_values(PRESSURE).groupby([ROUGHNESS, COUNT])
    return {key: [Point(*map(float, row)) for row in rows[columns].to_numpy()] for key, rows in groups}


def scenes(folder: Path) -> dict[tuple[float, int], thirdbody.Scene]:
    scene, points = thirdbody.Scene.load(folder / "scene.toml"), thirdbody.Sweep(folder).points
    return {(p.values[ROUGHNESS], p.values[COUNT]): scene.with_settings(p.values) for p in points}


def mixed(share: float, debris: float, direct: float) -> float:
    return share * debris + (1.0 - share) * direct


def draw(found: Series, estimates: dict[tuple[float, int], Sharing], direct: float, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(3, 1, figsize=(8.0, 9.0), sharex=True, layout="constrained")
    colors = dict(zip(sorted({key[0] for key in found}), ("blue", "green", "vermilion"), strict=False))
    most = max(key[1] for key in found)
    debris = float(np.mean([p.friction for points in found.values() for p in points if p.share > ALONE]))
    for (rms, count), points in found.items():
        color, many = LINE_COLORS[colors[rms]], count == most
        pressure = np.geomspace(0.7 * points[0].pressure, 1.4 * points[-1].pressure, 60)
        share, active = np.transpose([estimates[rms, count].at(p) for p in pressure])
        x = [p.pressure / 1e6 for p in points]
        label = f"{rms * 1e6:g} um rms, {count} particles"
        for axes, values, line in (
            (panels[0], [p.friction for p in points], mixed(share, debris, direct)),
            (panels[1], [p.share for p in points], share),
            (panels[2], [p.active for p in points], active),
        ):
            axes.plot(pressure / 1e6, line, color=color, lw=1.2, ls="-" if many else "--")
            axes.plot(x, values, "o" if many else "s", color=color, mfc=color if many else "white", ms=6, label=label)
    panels[0].plot([], [], color=INK, lw=1.2, label="estimate in closed form")
    for axes, name in zip(panels, ("friction coefficient", "share of the load on debris", "active debris"), strict=True):
        axes.set(xscale="log", ylabel=name)
        axes.set_ylim(bottom=0.0)
    panels[-1].set_xlabel("pressure (MPa)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def texts(found: Series) -> dict[str, str]:
    words = {}
    for (rms, count), points in found.items():
        first, last = points[0], points[-1]
        words[f"{rms * 1e6:g} um rms, {count} particles"] = (
            f"friction {first.friction:.3f} at {first.pressure / 1e6:g} MPa, {last.friction:.3f} at {last.pressure / 1e6:g} MPa; "
            f"share of the load on debris {first.share:.2f} and {last.share:.2f}"
        )
    return words


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path)
    parser.add_argument("-o", dest="picture", type=Path, required=True)
    requested = parser.parse_args()
    given = scenes(requested.sweep)
    sharing = {key: estimate(scene) for key, scene in given.items()}
    draw(read_sweep(requested.sweep), sharing, next(iter(given.values())).plates.contact.friction, requested.picture)
