"""A scene of four balls to spoil."""

import pytest
from balls import BALLS, edited


@pytest.fixture
def balls(tmp_path):
    """Writes the scene of four balls with texts replaced, as scene.toml in the test's folder; returns its path."""

    def write(*changes):
        path = tmp_path / "scene.toml"
        path.write_text(edited(BALLS, *changes), encoding="utf-8")
        return path

    return write
