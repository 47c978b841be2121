"""Gives the tests of this folder the builders of the theory tests."""

from __future__ import annotations

from types import ModuleType

import pytest
from theory import builders


@pytest.fixture(scope="session")
def make() -> ModuleType:
    """The module `builders`."""
    return builders
