"""Gives the tests of this folder the builders beside them."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def make() -> ModuleType:
    """The module `builders`; test folders are no packages, so it is loaded by its path."""
    name = "thirdbody_test_builders"
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("builders.py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
