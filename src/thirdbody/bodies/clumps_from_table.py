"""Clumps from a table of spheres, CSV or NPZ."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thirdbody.bodies.bounded_read import LARGEST, SMALLEST, read_bytes
from thirdbody.bodies.clump import Clump, clump_with_frame, quaternion_product, repeated_spheres
from thirdbody.bodies.sphere_table import SphereTable, refuse
from thirdbody.bodies.table_csv import Parse, read_csv
from thirdbody.bodies.table_npz import read_npz
from thirdbody.errors import Fault, InputError

SUFFIXES = (".csv", ".npz")

# Tolerance of unit quaternions: seven written digits are accepted; a larger deviation was meant as something else.
_UNIT = 1e-6
# Cost of mass properties and poses of closely packed spheres: 3 s and 60 MB for 100, 13 s and 0.4 GB for 200.
MAX_SPHERES = 100
# Copies of one shape differ by the rounding of their positions; in units of the largest radius.
_ALIKE = 11
# Signatures of other file types under a wrong suffix.
_MAGIC = {
    b"PK\x03\x04": "a ZIP archive (an NPZ file or a spreadsheet)",
    b"\x93NUMPY": "a single array (NPY)",
    b"\x89HDF": "an HDF5 file",
    **{b"\x80" + bytes([k]): "a pickle, which is never loaded" for k in range(2, 6)},
}


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of a table in ascending order of ids (m,), with clumps and poses.

    positions (m, 3) [m] of the centres of mass, orientations (m, 4) from principal frame to world; velocity (m, 3) [m/s] and
    angular_velocity (m, 3) [rad/s], or None.
    """

    ids: np.ndarray
    clumps: list[Clump]
    positions: np.ndarray
    quaternions: np.ndarray
    has_orientations: bool
    velocity: np.ndarray | None
    angular_velocity: np.ndarray | None


def load_bodies(path: str | Path, parse: Parse) -> Bodies:
    """Return the bodies in a CSV file (units in its header, read by `parse`) or an NPZ file (SI, no pickles).

    Spheres with one `clump` id are one rigid body with the mass properties of their union. Their centers are world coordinates. A
    quaternion rotates the body as given in the file about its centre of mass, which stays in place: the centers are then in the
    clump's own axes, shifted to the position of the body. The velocity is that of the centre of mass. InputError: all faults,
    each with the file and its line, or array and index; at most ten and the number of the rest.
    """
    return _bodies(_read(Path(path), parse))


def _read(path: Path, parse: Parse) -> SphereTable:
    file, suffix = str(path), path.suffix.lower()
    if suffix not in SUFFIXES:
        known = " or ".join(SUFFIXES)
        raise InputError(Fault("", f"'{path.suffix}' is not a table of bodies that can be read; save it as {known}", file))
    data = read_bytes(path)
    if not data:
        raise InputError(Fault("", "is empty", file))
    other = next((what for magic, what in _MAGIC.items() if data.startswith(magic)), "")
    if suffix == ".npz":
        if not data.startswith(b"PK"):
            raise InputError(Fault("", f"is {other or 'no ZIP archive'}, expected an NPZ file (numpy.savez)", file))
        return read_npz(file, data)
    if other:
        raise InputError(Fault("", f"is {other}, expected a CSV table", file))
    return read_csv(file, data, parse)


def _bodies(table: SphereTable) -> Bodies:
    """Return the clumps of the table. Raises InputError for unconnected bodies, repeated spheres, and non-unit quaternions."""
    _refuse_sizes(table)
    members = table.members()
    orientations, faults = _normalised_quaternions(table, members)
    known: dict[tuple[bytes, bytes], tuple[Clump, np.ndarray, np.ndarray]] = {}
    clumps, positions, quaternions = [], [], []
    for b, rows in enumerate(members):
        if len(rows) > MAX_SPHERES:
            message = f"{len(rows)} spheres, at most {MAX_SPHERES} make a body; is the column of ids the right one?"
            faults.append(table.body_fault(b, rows[0], message))
            continue
        anchor, radii = table.center[rows[0]], table.radius[rows]
        arms = table.center[rows] - anchor
        key = radii.tobytes(), (np.round(arms / radii.max(), _ALIKE) + 0.0).tobytes()
        if key not in known and (repeated := repeated_spheres(arms, radii)):
            for k, first in repeated:
                message = f"{table.named(rows[[k]])} repeats {table.named(rows[[first]])}: the same center and radius; remove one"
                faults.append(table.body_fault(b, rows[k], message))
            continue
        try:
            known[key] = known[key] if key in known else clump_with_frame(arms, radii)
        except InputError as error:
            loose = rows[[int(fault.key[len("spheres[") : -1]) for fault in error.faults]]
            message = f"{table.named(loose)} not connected to {table.named(rows[:1])}: a rigid body must be in one piece"
            faults.append(table.body_fault(b, rows[0], message))
            continue
        body, arm, frame = known[key]
        clumps.append(body)
        positions.append(anchor + arm)
        quaternions.append(frame if orientations is None else quaternion_product(orientations[b], frame))
    refuse(faults)
    has_orientations = table.quaternion is not None
    x, q = np.array(positions), np.array(quaternions)
    return Bodies(table.ids, clumps, x, q, has_orientations, table.velocity, table.angular_velocity)


def _refuse_sizes(table: SphereTable) -> None:
    """Raise InputError for the first sphere whose numbers cannot be right in any unit, with the number of the others."""
    furthest = np.maximum(table.radius, np.abs(table.center).max(axis=1))
    odd = np.flatnonzero((table.radius < SMALLEST) | (furthest > LARGEST))
    if not len(odd):
        return
    k, more = int(odd[0]), f", and {len(odd) - 1} more" if len(odd) > 1 else ""
    centre = ", ".join(f"{v:.3g}" for v in table.center[k])
    message = f"radius {table.radius[k]:.3g} m at ({centre}) m{more}: outside {SMALLEST:g} to {LARGEST:g} m; is the unit right?"
    raise InputError(table.sphere_fault("sphere", k, message))


def _normalised_quaternions(table: SphereTable, members: list[np.ndarray]) -> tuple[np.ndarray | None, list[Fault]]:
    """Return the normalised quaternions (m, 4), and the faults of those whose length is not near 1."""
    if table.quaternion is None:
        return None, []
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(table.quaternion, axis=1)
    faults = []
    for b in np.flatnonzero(~(np.abs(norms - 1.0) <= _UNIT)):
        message = f"its quaternion (w, x, y, z) has length {norms[b]:.9g}, expected 1 to within {_UNIT:g}"
        faults.append(table.body_fault(int(b), members[b][0], message))
    with np.errstate(invalid="ignore", divide="ignore"):
        return table.quaternion / norms[:, None], faults
