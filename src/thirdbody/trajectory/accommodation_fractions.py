"""Former name of what it imports; goes once no file uses it."""

from typing import Any

from thirdbody.trajectory import bed
from thirdbody.trajectory.bed import WORDS as WORDS
from thirdbody.trajectory.bed import accommodation_text as accommodation_text
from thirdbody.trajectory.bed import short_accommodation_text as short_accommodation_text


def accommodation_fractions(run: Any) -> dict[str, float] | None:
    return bed.accommodation_fractions(run.drag)
