"""The scene: the complete content of a scene file, checked, frozen and in SI units.

In Python, quantities are given as floats in SI or as text with a unit; in a file always as text with a unit. The tables are
defined in `tables` and in `thirdbody.debris`; import them from here. Further kinds of debris are given as tables (dictionaries)
or as instances of their classes.
"""

from __future__ import annotations

import difflib
import itertools
import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import PrivateAttr, ValidationError

from thirdbody.atomic_files import write_output
from thirdbody.debris.contract import MAX_SPHERES
from thirdbody.debris.file import File
from thirdbody.debris.irregular import Irregular
from thirdbody.debris.mesh import Mesh
from thirdbody.debris.registry import Debris, DebrisKinds, kinds_of
from thirdbody.debris.spheres import Ball, Spheres
from thirdbody.debris.spots import Spot, Spots
from thirdbody.errors import Fault
from thirdbody.scene.checks import faults_between, number_faults, raw_faults
from thirdbody.scene.motion import Constant as ConstantVelocity
from thirdbody.scene.motion import Motion, Pause, Ramp, Stroke, Table
from thirdbody.scene.output import Output
from thirdbody.scene.settings import apply_settings
from thirdbody.scene.tables import Contact, Domain, Effects, LowerPlate, Material, Measures, PairTable, Plates, Solver, UpperPlate
from thirdbody.schema.fields import Text, Whole, listing, plain
from thirdbody.schema.parts import Location, Part, Wrong, bundle
from thirdbody.schema.read import Source, checked, read_text, read_toml, with_version
from thirdbody.schema.sizes import Constant, Lognormal, Normal, Uniform
from thirdbody.schema.write import toml_text

__all__ = [
    "Ball", "Constant", "ConstantVelocity", "Contact", "Debris", "Domain", "Effects", "File", "Irregular", "Lognormal",
    "LowerPlate", "Material", "Measures", "Mesh", "Motion", "Normal", "Output", "PairTable", "Pause", "Plates", "Ramp", "Scene",
    "Solver", "Spheres", "Spot", "Spots", "Stroke", "Table", "Uniform", "UpperPlate",
]  # fmt: skip

VERSION = 1

_TABLES: dict[str, type[Part]] = {
    "solver": Solver, "output": Output, "contact": Contact, "effects": Effects, "measures": Measures, "domain": Domain,
    "pairs.0": PairTable, "plates.upper": UpperPlate,
}  # fmt: skip
"""Tables whose keys are suggested with their full path when given without it."""


class Scene(Part):
    """A whole scene: `Scene.load(path)`, or built in Python. Checked, frozen, in SI units.

    Raises
    ------
    InputError
        With all faults at once, each with its key and, in a file, its line.

    Examples
    --------
    >>> scene = thirdbody.Scene.load("example.toml")
    >>> scene.solver.distance, scene.pair("steel", "steel").friction
    (1e-07, 0.2)
    >>> scene.with_settings({"solver.distance": "0.3 um"}).solver.distance
    3e-07
    """

    scene: Annotated[int, Whole(ge=VERSION, le=VERSION)] = VERSION
    """Version of the format; required in a file. Example: 1."""
    title: Text = ""
    """Title of the run in tables and pictures. Example: "a dense bed of steel debris"."""
    materials: dict[str, Material]
    pairs: Annotated[tuple[PairTable, ...], listing("a list of tables [[pairs]]")] = ()
    debris: Annotated[tuple[Debris, ...], listing("a list of tables [[debris]]")]
    domain: Domain
    plates: Plates = Plates()
    contact: Contact = Contact()
    effects: Effects = Effects()
    measures: Measures = Measures()
    solver: Solver
    output: Output

    _source: Source = PrivateAttr(default_factory=Source)
    _kinds: DebrisKinds = PrivateAttr(default_factory=DebrisKinds)

    @classmethod
    def load(cls, path: str | os.PathLike[str], plugins: Iterable[str | Path] = ()) -> Scene:
        """Return the scene in a TOML file.

        Parameters
        ----------
        path : str or Path
        plugins : iterable of str or Path
            Python files with further kinds of debris.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            With every fault, each with file, line and column.
        UsageError
            A plug-in cannot be used.
        """
        return cls.parse(read_text(path), os.fspath(path), plugins=plugins)

    @classmethod
    def of(cls, given: Scene | str | os.PathLike[str] | Mapping[str, Any], plugins: Iterable[str | Path] = ()) -> Scene:
        """Return the scene itself, the one in a TOML file, or the one described by a dictionary of tables.

        Parameters
        ----------
        given : Scene, str, Path or dict
            Numbers of a dictionary are in SI, or text with a unit.
        plugins : iterable of str or Path
            As in `load`.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            With every fault.
        TypeError
            `given` is something else.
        """
        if isinstance(given, Scene):
            return given
        if isinstance(given, Mapping):
            return cls._checked(dict(given), Source(), [], DebrisKinds(tuple(plugins)), file=False)
        if isinstance(given, str | os.PathLike):
            return cls.load(given, plugins)
        raise TypeError(f"expected a Scene, the path of a scene file or a dictionary, not {type(given).__name__}")

    @classmethod
    def parse(
        cls, text: str, name: str = "scene", folder: str | os.PathLike[str] | None = None, plugins: Iterable[str | Path] = ()
    ) -> Scene:
        """Return the scene in a TOML text. Raises like `load`.

        Parameters
        ----------
        text : str
            Content of a scene file.
        name : str
            Name of the file in messages.
        folder : str or Path, optional
            Folder of the files that the scene names; None: that of `name`.
        plugins : iterable of str or Path
            As in `load`.

        Returns
        -------
        Scene
        """
        document, source = read_toml(text, name)
        source = source if folder is None else replace(source, folder=os.fspath(folder))
        return cls._checked(document, source, with_version(document, "scene", VERSION), DebrisKinds(tuple(plugins)))

    @classmethod
    def _checked(
        cls, document: dict[str, Any], source: Source, faults: list[Wrong], kinds: DebrisKinds, file: bool = True
    ) -> Scene:
        scene = checked(cls, document, source, faults, {"file": file, "kinds": kinds})
        scene._source, scene._kinds = source, kinds
        return scene

    @classmethod
    def suggestion(cls, key: str) -> str:
        """Return a phrase that suggests the nearest table, or for a key of a table its whole path: `solver.distance`."""
        inner: dict[str, list[str]] = {}  # {"distance": ["'solver.distance'"]}
        for location, table in _TABLES.items():
            for name in table.model_fields.keys() - {table.extra_keys}:
                inner.setdefault(name, []).append(f"'{location}.{name}'")
        close = difflib.get_close_matches(key, cls.model_fields, 1, 0.7) or difflib.get_close_matches(key, inner, 1, 0.7)
        if not close or close[0] in cls.model_fields:
            return super().suggestion(key)
        return f"did you mean {' or '.join(inner[close[0]])}?"

    @classmethod
    def rules(cls, raw: dict[str, Any], context: Any) -> list[Wrong]:
        """Return faults between tables, as far as they can be read."""
        if too_many := number_faults(raw):  # reported alone: reading them all would take too long
            raise bundle(too_many)

        def sound(part: type[Any], table: Any) -> Any:
            """Return the checked table, or None when it has faults."""
            try:
                return part.model_validate(table, context=context)
            except ValidationError:
                return None

        plates, output = sound(Plates, raw.get("plates", {})), sound(Output, raw.get("output"))
        # Plates that are faulty themselves may be intended to move.
        moving = plates is None or plates.moving()
        return raw_faults(raw, kinds_of(context), moving, output.every_kind if output else "")

    def checks(self) -> list[Wrong]:
        """Return faults between tables that are valid on their own."""
        faults: list[Wrong] = []
        spheres = [(debris.count or 1) * debris.max_spheres() for debris in self.debris]
        if sum(spheres) > MAX_SPHERES:
            text = f"the debris would have up to {sum(spheres):.3g} spheres, at most {MAX_SPHERES:.3g} are computed; lower count"
            faults.append((("debris", spheres.index(max(spheres)), "count"), text))
        if any(debris.in_plane for debris in self.debris):
            upper, why = self.plates.upper, "drives planar particles out of their plane y = 0"
            if upper is not None and upper.motion.y:
                faults.append((("plates", "upper", "motion", "y"), why))
            if self.effects.gravity is not None and self.effects.gravity[1] != 0.0:
                faults.append((("effects", "gravity", 1), why))
        names = [debris.name for debris in self.debris]
        for k, name in enumerate(names):
            if name and name in names[:k]:  # no table could distinguish them
                faults.append((("debris", k, "name"), f"'{name}' is the name of debris[{names.index(name)}] too"))
        return faults + faults_between(self.plates, self.domain, self.solver, self.output, self.measures)

    @property
    def population_names(self) -> list[str]:
        """Return names of the populations: `name`, else material and kind: `bronze (irregular)`, `bronze (irregular) 2`."""
        used = {debris.name for debris in self.debris if debris.name}
        names = []
        for debris in self.debris:
            name = debris.name
            if not name:
                plain_name = f"{debris.material} ({debris.kind})"
                numbered = (f"{plain_name} {k}" for k in itertools.count(2))
                name = next(text for text in itertools.chain([plain_name], numbered) if text not in used)
                used.add(name)
            names.append(name)
        return names

    def pair(self, first: str, second: str) -> PairTable:
        """Return the pair of two materials, in either order.

        Parameters
        ----------
        first, second : str
            Names of the materials.

        Returns
        -------
        PairTable

        Raises
        ------
        KeyError
            The scene has no such pair.
        """
        for pair in self.pairs:
            if set(pair.between) == {first, second}:
                return pair
        raise KeyError(f"no pair for '{first}' and '{second}'")

    def document(self) -> dict[str, Any]:
        """Return the scene as a file holds it.

        Returns
        -------
        dict
            Plain tables, defaults written out, quantities as text with units.
        """
        return plain(self.model_dump(exclude_none=True))

    def to_toml(self) -> str:
        """Return the scene as TOML text; `Scene.parse` gives an equal scene.

        Returns
        -------
        str

        Raises
        ------
        InputError
            An option cannot be written as TOML.
        """
        return toml_text(self.document())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scene file; `Scene.load` gives an equal scene.

        Parameters
        ----------
        path : str or Path
            The file.

        Raises
        ------
        InputError, OutputError
            An option cannot be written as TOML; the file cannot be written.
        """
        write_output(Path(path), self.to_toml().encode())

    def with_settings(self, settings: Mapping[str, Any]) -> Scene:
        """Return the scene with values replaced.

        Parameters
        ----------
        settings : dict
            Values by key, such as {"solver.distance": "1 um", "debris.0.count": "20"}. Text is read as a TOML value if it is one,
            else used unchanged; numbers and arrays are in SI; None removes the key. Giving one of two keys that exclude each
            other (distance and duration; load, pressure and gap) drops the other.

        Returns
        -------
        Scene

        Raises
        ------
        InputError
            With every fault.
        """
        if not settings:
            return self
        document, locations = apply_settings(self.document(), settings)
        kinds = self._kinds.including(type(debris) for debris in self.debris)
        # A setting can make a key of the file invalid, so every fault here is one of the settings.
        scene = self._checked(document, Source().overridden([()]), [], kinds)
        scene._source = self._source.overridden(locations)
        return scene

    @property
    def name(self) -> str | None:
        """Name of the scene's file without its suffix; None for a scene that was built in Python, or a file of dots only."""
        stem = Path(self._source.file).stem if self._source.file else ""
        return stem if stem.strip(". ") else None  # "..": the run's folder must not be a parent folder

    def beside(self, name: str) -> Path:
        """Return the path of a file that the scene names: relative to the scene's own file."""
        if self._source.folder is not None:
            return Path(self._source.folder) / name
        return Path(self._source.file).parent / name if self._source.file else Path(name)

    def fault(self, location: Location, message: str) -> Fault:
        """Return a fault at a place such as ("contact", "springs"), with file and line if there is a file."""
        return self._source.fault(location, message)
