"""Gives the tests of this folder the builders beside them."""

import pytest
from theory import builders


@pytest.fixture(scope="session")
def make():
    return builders
