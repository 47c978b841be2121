"""What a compiled result depends on, and what may be deleted."""

from __future__ import annotations

import importlib
import os
import sys

from thirdbody import cache
from thirdbody.laws.generated import source_files


def test_only_our_own_folders_are_dropped(tmp_path):
    theirs = [tmp_path / name for name in ("data", "thesis", "0123456789abcdefg", "0123456789ABCDEF")]
    ours = [tmp_path / f"{k:016x}" for k in range(7)]
    for k, folder in enumerate(theirs + ours):
        folder.mkdir()
        os.utime(folder, (k, k))
    cache._prune(tmp_path)
    assert all(folder.is_dir() for folder in theirs)
    assert [folder.is_dir() for folder in ours] == [False] * 3 + [True] * cache.KEPT


def test_a_law_depends_on_all_that_it_can_reach(tmp_path, monkeypatch):
    package = tmp_path / "somelaws"
    (package / "deep").mkdir(parents=True)
    (tmp_path / "beside_it.py").write_text("FACTOR = 2.0\n")
    (tmp_path / "further.py").write_text("import math\n")
    (package / "__init__.py").write_text("")
    (package / "common.py").write_text("import further\nSCALE = 1.0\n")
    (package / "deep" / "__init__.py").write_text("")
    law = "import beside_it\nimport numpy\nfrom ..common import SCALE\nfrom .. import common\n\ndef kernel():\n    return SCALE\n"
    (package / "deep" / "law.py").write_text(law)
    monkeypatch.syspath_prepend(str(tmp_path))
    module = importlib.import_module("somelaws.deep.law")
    found = {path.relative_to(tmp_path).as_posix() for path in source_files([module.kernel])}
    for name in [name for name in sys.modules if name.partition(".")[0] in ("somelaws", "beside_it", "further")]:
        del sys.modules[name]
    expected = {"__init__.py", "common.py", "deep/__init__.py", "deep/law.py"}
    assert found == {f"somelaws/{name}" for name in expected} | {"beside_it.py", "further.py"}
