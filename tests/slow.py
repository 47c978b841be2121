"""Values of a parameter outside the default command: `@pytest.mark.parametrize("mu", [0.2, slow(0.05)])`."""

import pytest


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.full(kind="slow"))
