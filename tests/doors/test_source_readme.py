"""src/README.md: the modules that it names exist."""

from __future__ import annotations

import re

from pages import ROOT

PAGE = ROOT / "src" / "README.md"
PACKAGE = ROOT / "src" / "thirdbody"
PACKAGES = {path.name for path in PACKAGE.iterdir() if path.is_dir()}


def test_modules_that_the_page_names_exist():
    text = PAGE.read_text(encoding="utf-8")
    names = {name for name in re.findall(r"`([a-z_]+(?:\.[a-z_]+)*)`", text) if name.split(".")[0] in PACKAGES}
    missing = [name for name in names if not _is_module(name)]
    assert len(names) > 20 and not missing, sorted(missing)


def _is_module(name: str) -> bool:
    """Return whether a dotted name is a package or a module, or a name at the top of a module."""
    path = PACKAGE.joinpath(*name.split("."))
    if path.is_dir() or path.with_suffix(".py").is_file():
        return True
    module = path.parent.with_suffix(".py")
    return module.is_file() and re.search(rf"^(def|class) {path.name}\b|^{path.name}\b.*=", module.read_text(encoding="utf-8"),
                                          re.MULTILINE) is not None  # fmt: skip
