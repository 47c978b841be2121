"""Arrays of a run: per frame, over the frames, names and texts, from `run.vtkhdf`.

Only committed frames are read: the file of a run that was killed, or is still running, ends at its last one.
"""

from __future__ import annotations

import operator
import os
import tomllib
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from thirdbody.errors import InputError
from thirdbody.surfaces.surface import Surface
from thirdbody.surfaces.wear import worn_surfaces
from thirdbody.trajectory.names import BLOCKS, MAPS, PLATES, POSITION, PROFILE_GROUP, SUMMARY_TEXT, SURFACE_WEAR
from thirdbody.trajectory.open_file import FILE_NAME, OpenFile, damage_as_fault, read_text, refuse_false_texts, refuse_unsound
from thirdbody.trajectory.read_blocks import BlockReader, Named, RebuiltSpheres, read_maps, read_surfaces, refuse_other_plates

Result = TypeVar("Result")


class NoFrame(InputError, IndexError):
    """The run has no such frame."""


class RunArrays(OpenFile):
    """The arrays of a run, read from its file on demand; a context manager. SI units."""

    def __init__(self, path: str | Path):
        super().__init__(Path(path) / FILE_NAME if os.path.isdir(path) else Path(path))
        try:
            self.steady(lambda: None)
        except BaseException:
            self.close()
            raise

    def _connect(self) -> None:
        """Open the file and read its headers; when an open file is reopened, its number of frames does not grow."""
        super()._connect()
        with damage_as_fault(self.path):
            self.stored = Named((name, BlockReader(self.file["VTKHDF"][name], self.path)) for name in BLOCKS)
            self._blocks: dict[str, Any] = Named(self.stored)
            self._series_group, self._scene = self.file["series"], self.file["scene"]
            counts = [block.frames for block in self.stored.values()]
            # A run killed between two counts has one count too high: the lowest holds for all blocks.
            frames = min(counts + [int(self._series_group.attrs["NSteps"])])
            refuse_false_texts(self._scene)
            self.header = {name: self._text(name) for name in self._scene if name != SUMMARY_TEXT}
            self.state_names: list[str] = list(self.header["state_names"])
            self.reason_names: list[str] = list(self.header["reason_names"])
            refuse_unsound(self.file, self.header, frames)
            codes = {"state": len(self.state_names), "state_reason": len(self.reason_names)}
            self.stored["clumps"].names_of = codes
            self.recorded = set(self.header.get("blocks", BLOCKS)) | {"plates"}
            if "spheres" not in self.recorded:
                self._blocks["spheres"] = RebuiltSpheres(self.stored["clumps"], self.stored["spheres"], self.path)
            self.frames: int = min(getattr(self, "frames", frames), frames)

    def _steady(self, where: str, read: Callable[[], Result]) -> Result:
        """Return the result of `read`; report damage with its place, and read a file again while it is being written."""
        return self.steady(damage_as_fault(self.path, where)(read))

    def _text(self, name: str) -> Any:
        with damage_as_fault(self.path, f"/scene/{name}"):
            return read_text(self._scene[name])

    @property
    def scene_text(self) -> str:
        """Resolved scene as the run used it."""
        return str(self.header["scene_text"])

    @cached_property
    def scene_tables(self) -> dict[str, Any]:
        """Its tables; empty where it is no TOML."""
        with suppress(KeyError, tomllib.TOMLDecodeError):
            return tomllib.loads(self.scene_text)
        return {}

    @cached_property
    def times(self) -> np.ndarray:
        """Times of the frames, (F,) [s]."""
        return self._steady("the times", lambda: self.file["VTKHDF/clumps/Steps/Values"][: self.frames])

    @cached_property
    def states(self) -> np.ndarray:
        """State codes, (F, B) uint8; their names are `state_names`."""
        return self._history("state")

    @cached_property
    def reasons(self) -> np.ndarray:
        """Reason codes, (F, B); their names are `reason_names`."""
        return self._history("state_reason")

    @cached_property
    def forecast(self) -> np.ndarray:
        """Forecast state codes, (F, B) uint8; AttributeError when the run recorded none."""
        return self._history("forecast")

    @property
    def has_states(self) -> bool:
        """Whether the run recorded states, with their reasons."""
        return {"state", "state_reason"} <= set(self._names("clumps"))

    @property
    def has_contacts(self) -> bool:
        """Whether the run recorded contacts."""
        return "contacts" in self.recorded

    def _history(self, name: str) -> np.ndarray:
        if name not in self._names("clumps"):
            raise AttributeError(f"{self.path}: this run recorded no '{name}' of its bodies")
        return self._steady("", lambda: self._blocks["clumps"].history(name, self.frames))

    def _names(self, block: str) -> list[str]:
        return self._steady("", lambda: self._blocks[block].names)

    @cached_property
    def series(self) -> dict[str, np.ndarray]:
        """Series by name, each (F,) or (F, 3); units in `units`."""
        return self._steady(
            "the series", lambda: Named((name, self._series_group[name][: self.frames]) for name in self._series_group)
        )

    @cached_property
    def profiles(self) -> dict[str, np.ndarray]:
        """Profiles by name, each (F, bins) or (F, bins, ...), empty without `output.profiles`; units in `units`.

        Means in slabs across one axis (`header["profiles"]["axis"]`) and over the output interval: `position` of the middle of
        each slab (F, bins) [m], `velocity` (F, bins, 3) [m/s], `solid_fraction`, `contact_stress` and `kinetic_stress`
        (F, bins, 3, 3) [Pa], and more; `trajectory.profiles` defines them, `thirdbody keys profiles` lists all names.
        """
        bins = self.header.get(PROFILE_GROUP, {}).get("bins", 0)
        rows = slice(0, self.frames * bins)
        read = self._steady("the profiles", lambda: {name: v[rows] for name, v in self.file.get(PROFILE_GROUP, {}).items()})
        tails = {name: (3, 3) if values.shape[1:] == (9,) else values.shape[1:] for name, values in read.items()}
        return Named((name, values.reshape(self.frames, bins, *tails[name])) for name, values in read.items())

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each series and profile, `1` for a pure number."""
        groups = (PROFILE_GROUP, "series")
        return self._steady(
            "the units", lambda: Named((n, str(v.attrs["units"])) for g in groups for n, v in self.file.get(g, {}).items())
        )

    @cached_property
    def material_names(self) -> list[str]:
        """Names of the materials, indexed by the bodies' array `material`."""
        return list(self.header.get("materials", []))

    @cached_property
    def population_names(self) -> list[str]:
        """Names of the populations, indexed by the bodies' array `population`."""
        if "populations" in self.header:
            return list(self.header["populations"])
        try:  # of earlier versions: material and kind, numbered where they repeat
            plain = [f"{table['material']} ({table.get('kind', 'irregular')})" for table in self.scene_tables.get("debris", [])]
        except (KeyError, TypeError, AttributeError):
            return []
        before = [plain[:k].count(name) for k, name in enumerate(plain)]
        return [f"{name} {count + 1}" if count else name for name, count in zip(plain, before, strict=True)]

    def bodies(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of the bodies (clumps) in one frame.

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            One row per body: `position` (B, 3) [m], `quaternion` (B, 4) (w, x, y, z), `velocity` (B, 3) [m/s], `state` (B,),
            `friction_work` (B,) [J] and more; all names and units: `thirdbody keys bodies`.
        """
        return self.block("clumps", frame)

    def spheres(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of the spheres of all bodies in one frame.

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            One row per sphere: `position` (n, 3) [m], `radius` (n,) [m], `clump` (n,) the row of its body, ...
        """
        return self.block("spheres", frame)

    def contacts(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of the contacts in one frame; there may be none.

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            One row per contact: `position` (n, 3) [m], `force` (n, 3) [N], `normal_force` (n,) [N], `utilisation` (n,), ...

        Raises
        ------
        InputError
            The run file holds none: `output.blocks` of its scene leaves them out.
        """
        if not self.has_contacts:
            raise InputError(f"{self.path}: holds no contacts: output.blocks of its scene leaves them out")
        return self.block("contacts", frame)

    def plates(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the corners of the plates in one frame.

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            `position` (8, 3) [m]: lower four, upper four; (4, 3) without an upper plate, (0, 3) without plates.
        """
        return self.block("plates", frame)

    @cached_property
    def scene_bodies(self) -> int:
        """Number of bodies of the scene: more than the file holds where `output.sample` restricts it."""
        return int(self.header.get("scene_bodies", self.rows("clumps", 0) if self.frames else 0))

    @cached_property
    def surfaces(self) -> dict[str, Surface]:
        """Surfaces of the rough plates at the start, by `lower` and `upper`; none of flat plates."""
        return self._steady("the surfaces", lambda: read_surfaces(self.file))

    def surfaces_at(self, frame: int = -1) -> dict[str, Surface]:
        """Return `surfaces` as they are in a frame: less what wear has taken from them until then (`plates.wear`).

        Parameters
        ----------
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to Surface
        """
        if SURFACE_WEAR not in self.map_units:
            return self.surfaces
        return worn_surfaces(self.surfaces, np.stack([self.maps(plate, frame)[SURFACE_WEAR] for plate in PLATES]))

    def surface(self, plate: str, frame: int = -1) -> Surface | None:
        """Return the surface of a plate.

        Parameters
        ----------
        plate : {lower, upper}
        frame : int, negative ones count from the end
            Matters where wear changes the surface (`plates.wear`).

        Returns
        -------
        Surface or None
            `heights` (n_y, n_x) [m] over its mean plane, towards the debris, `spacing` along x and y [m], `coefficients` of the
            spline; None for a flat plate.
        """
        refuse_other_plates(plate)
        return self.surfaces_at(frame).get(plate) if self.frames else self.surfaces.get(plate)

    def surface_position(self, plate: str, frame: int = -1) -> np.ndarray:
        """Return the displacement of a plate's surface along x and y, and the height of its mean plane, (3,) [m]."""
        return np.array(self.plates(frame)[POSITION][4 if plate == "upper" else 0])

    @cached_property
    def map_units(self) -> dict[str, str]:
        """Unit of each map of the plates, by name; none without `measures.cell`."""
        return self._steady("the maps", lambda: {n: str(v.attrs["units"]) for n, v in self.file.get(MAPS, {}).items()})

    def maps(self, plate: str, frame: int = -1) -> dict[str, np.ndarray]:
        """Return what measures have left on a plate since the start of the run.

        Parameters
        ----------
        plate : {lower, upper}
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray
            Maps by name, each (n_y, n_x): the cell [j, i] begins at i L_x/n_x, j L_y/n_y of the plate's own coordinates, in which
            the plate was at the start. Units are in `map_units`; empty without `measures.cell`.

        Raises
        ------
        ValueError, IndexError
            There is no such plate, or no such frame.
        """
        refuse_other_plates(plate)
        number = self.frame_number(frame)
        both = self._steady("the maps", lambda: read_maps(self.file, number))
        return {name: values[PLATES.index(plate)] for name, values in both.items()}

    def block(self, name: str, frame: int = -1) -> dict[str, np.ndarray]:
        """Return all arrays of one block of the file.

        Parameters
        ----------
        name : {spheres, clumps, contacts, plates}, the bodies are `clumps`
        frame : int, negative ones count from the end

        Returns
        -------
        dict of str to ndarray, one row per thing of the block
        """
        number = self.frame_number(frame)
        return self.steady(lambda: self._blocks[name].read(number))

    def array(self, block: str, name: str, frame: int = -1) -> np.ndarray:
        """Return one array of one block without reading the others.

        Parameters
        ----------
        block, name : str
            Names of the block and of the array.
        frame : int, negative ones count from the end

        Returns
        -------
        ndarray, one row per thing of the block
        """
        number = self.frame_number(frame)
        return self.steady(lambda: self._blocks[block].array(name, number))

    def rows(self, block: str, frame: int = -1) -> int:
        """Return the number of rows of one block in one frame."""
        number = self.frame_number(frame)
        return self.steady(lambda: self._blocks[block].rows(number))

    def frame_number(self, frame: int) -> int:
        """Return the frame number counted from 0. Raises IndexError for one that is not there, TypeError for no whole number."""
        try:
            frame = operator.index(frame)
        except TypeError:
            raise TypeError(f"{self.path}: a frame is a whole number, not {frame!r}") from None
        if not -self.frames <= frame < self.frames:
            inside = f"from {-self.frames} to {self.frames - 1}" if self.frames else "none: nothing was written yet"
            raise NoFrame(f"{self.path}: no frame {frame}; frames are {inside}")
        return frame % self.frames

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.frames

    def __bool__(self) -> bool:
        """Return True, also for a run without frames."""
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Run {self.path}: {self.frames} frames>"
