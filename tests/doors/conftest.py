"""The command line called as a user calls it, and a scene of four balls to spoil."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from balls import BALLS


@dataclass(frozen=True)
class Reported:
    """What a command said and how it ended."""

    code: int
    out: str
    err: str


@pytest.fixture
def balls(tmp_path: Path) -> Callable[..., Path]:
    """Writes the scene of four balls with texts replaced, as scene.toml in the test's folder; returns its path."""

    def write(*changes: tuple[str, str]) -> Path:
        text = BALLS
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., Reported]:
    """`thirdbody ARGUMENTS` in this process, in the test's folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Reported:
        from thirdbody.cli.main import main

        monkeypatch.setattr(sys, "argv", ["thirdbody", *map(str, arguments)])
        capsys.readouterr()
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        said = capsys.readouterr()
        return Reported(code, said.out, said.err)

    return call
