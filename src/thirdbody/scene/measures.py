"""The table of measures of a scene."""

from typing import Any, ClassVar

from thirdbody.scene.field_types import PositiveLength
from thirdbody.scene.schema_base import Part


class Measures(Part):
    """Measures by name as given in the file, and the cells of their maps; they read contacts and change nothing."""

    extra_keys: ClassVar[str] = "named"
    cell: PositiveLength | None = None
    """Side of the cells of the maps on both plates, rounded so that whole cells fill the domain; no maps where it is not given.

    Example: "0.5 um".
    """
    named: dict[str, Any] = {}
