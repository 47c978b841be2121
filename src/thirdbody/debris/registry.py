"""Registry of kinds of debris: built in (this package), installed (entry points), and in files named on the command line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from pkgutil import iter_modules
from typing import Annotated, Any

from pydantic import GetJsonSchemaHandler, ValidationInfo, ValidatorFunctionWrapHandler
from pydantic_core import core_schema

from thirdbody import debris
from thirdbody.debris.contract import DebrisKind
from thirdbody.errors import PLUGIN_FILE, UsageError
from thirdbody.schema.fields import Schema
from thirdbody.schema.parts import table_by_kind

GROUP = "thirdbody.debris_kinds"
"""Group of entry points; each is the class of a kind, under the name of the kind."""

FIRST = ("irregular", "spheres", "mesh", "spots", "file")
"""Kinds that lists begin with, in this order; the others follow by name."""


class DebrisKinds(Mapping[str, type[DebrisKind]]):
    """The kinds of debris by name: built-in, installed, and those of plug-in files.

    An installed one is imported on first use. Raises UsageError for an invalid plug-in file, and where two kinds have one name.
    """

    def __init__(self, files: Sequence[str | Path] = ()) -> None:
        self.of_files: dict[str, tuple[str, type[DebrisKind]]] = {}
        for file in files:
            from thirdbody.laws.registry import DEBRIS_KINDS, load_module

            kinds = getattr(load_module(Path(file)), DEBRIS_KINDS, ())
            if not isinstance(kinds, tuple | list):
                raise UsageError(f"plug-in {file}: {DEBRIS_KINDS} must be a tuple of classes derived from DebrisKind")
            for kind in kinds:
                try:
                    name = name_of(checked_kind(kind))
                except TypeError as problem:
                    raise UsageError(f"plug-in {file}: {problem}") from None
                if name in built_in() or name in self.of_files:
                    raise UsageError(f"'{self.source(name)}' and '{file}' both bring the kind of debris '{name}'")
                self.of_files[name] = (str(file), kind)

    @cached_property
    def installed(self) -> dict[str, EntryPoint]:
        """Installed kinds that are not imported yet."""
        points = {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda point: point.name)}
        for name, point in points.items():
            if name in built_in() or name in self.of_files:
                raise UsageError(f"'{point.value}' and '{self.source(name)}' both bring the kind of debris '{name}'")
        return points

    def including(self, kinds: Iterable[type[DebrisKind]]) -> DebrisKinds:
        """Return these kinds and those of tables that were built from classes of other kinds."""
        result = DebrisKinds()
        result.of_files = self.of_files | {name: (kind.__module__, kind) for kind in kinds if (name := name_of(kind)) not in self}
        return result

    def source(self, name: str) -> str:
        """Return the provider of a kind: thirdbody, a file, or an entry point."""
        if name in built_in():
            return "thirdbody"
        return self.of_files[name][0] if name in self.of_files else self.installed[name].value

    def __getitem__(self, name: str) -> type[DebrisKind]:
        if name in built_in():
            return built_in()[name]
        if name in self.of_files:
            return self.of_files[name][1]
        point = self.installed[name]
        try:
            return checked_kind(point.load(), name)
        except Exception as problem:  # any exception of a plug-in on import
            raise ValueError(f"'{name}' ({point.value}) did not load: {type(problem).__name__}: {problem}") from problem

    def __iter__(self) -> Iterator[str]:
        yield from built_in()
        yield from self.of_files
        yield from self.installed

    def __contains__(self, name: object) -> bool:
        return any(name == known for known in self)  # installed kinds are read last, and none is imported

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def usable(self) -> dict[str, type[DebrisKind]]:
        """Return all kinds that can be imported."""
        failures = self.failures()
        return {name: self[name] for name in self if name not in failures}

    def failures(self) -> dict[str, str]:
        """Return why installed kinds cannot be imported, by name."""
        result = {}
        for name in self.installed:
            try:
                self[name]
            except ValueError as problem:
                result[name] = str(problem)
        return result

    # Registries are equal: a scene does not depend on where its kinds come from.
    def __eq__(self, other: object) -> bool:
        return isinstance(other, DebrisKinds)

    def __hash__(self) -> int:
        return hash(DebrisKinds)


@cache
def built_in() -> dict[str, type[DebrisKind]]:
    """Return the built-in kinds by name: those of the modules beside this one that have a `KIND`."""
    modules = [import_module(f"{debris.__name__}.{module.name}") for module in iter_modules(debris.__path__)]
    kinds = {name_of(module.KIND): module.KIND for module in modules if hasattr(module, "KIND")}
    return {name: kinds[name] for name in (*FIRST, *sorted(kinds.keys() - set(FIRST)))}


def name_of(kind: type[DebrisKind]) -> str:
    """Return the name of a kind, the default of its field `kind`; empty if the class has none."""
    field = kind.model_fields.get("kind")
    return field.default if field is not None and isinstance(field.default, str) else ""


def checked_kind(kind: Any, name: str | None = None) -> type[DebrisKind]:
    """Return the class if it is a kind of debris (of this name). Raises TypeError."""
    if not (isinstance(kind, type) and issubclass(kind, DebrisKind)):
        raise TypeError(f"{getattr(kind, '__name__', kind)!s} is no class derived from DebrisKind")
    if not name_of(kind):
        raise TypeError(f'{kind.__name__} has no name: declare kind: Literal["name"] = "name"')
    if name is not None and name_of(kind) != name:
        raise TypeError(f"{kind.__name__} is the kind '{name_of(kind)}', not '{name}'")
    return kind


def kinds_of(context: Any) -> DebrisKinds:
    """Return the kinds that a scene is read with, from the context of the validation."""
    given = context.get("kinds") if isinstance(context, dict) else None
    return DebrisKinds() if given is None else given


class _DebrisTable:
    """Field type of a [[debris]] table: `kind` selects the class that reads the other keys."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        def read(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
            if isinstance(value, DebrisKind):
                return value
            return table_by_kind(value, info, "kind", kinds_of(info.context), f"; {PLUGIN_FILE}")

        union = core_schema.union_schema([handler.generate_schema(kind) for kind in built_in().values()])
        anything = core_schema.any_schema()
        as_it_is = core_schema.wrap_serializer_function_ser_schema(lambda value, dump: dump(value), schema=anything)
        return core_schema.with_info_wrap_validator_function(read, union, serialization=as_it_is)

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler) -> Schema:
        result = handler(schema)
        others = [kind for name, kind in DebrisKinds().usable().items() if name not in built_in()]
        return result | {"anyOf": result["anyOf"] + [handler(kind.__pydantic_core_schema__) for kind in others]}


Debris = Annotated[DebrisKind, _DebrisTable()]
