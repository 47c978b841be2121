"""The generated parts of src/README.md: `python tests/source_readme.py` writes them anew."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import thirdbody.kernels.columns as columns
from thirdbody.kernels.columns.table import Table

SOURCE = Path(__file__).resolve().parents[1] / "src"
PAGE = SOURCE / "README.md"
BLOCK = r"(<!-- generated: {name} -->\n).*?(<!-- end -->)"


def rooms() -> str:
    """Return a table of all packages with the first line of their docstring, in the order of their names."""
    lines = ["| room | what it holds |", "|---|---|"]
    for path in sorted((SOURCE / "thirdbody").rglob("__init__.py")):
        name = ".".join(path.parent.relative_to(SOURCE / "thirdbody").parts)
        docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        lines.append(f"| `{name or 'thirdbody'}` | {docstring.splitlines()[0] if docstring else ''} |")
    return "\n".join(lines)


def tables() -> str:
    """Return the columns of all tables, one table after the other, in the order of their modules' names."""
    parts = []
    for module in pkgutil.iter_modules(columns.__path__):
        found = importlib.import_module(f"{columns.__name__}.{module.name}")
        if isinstance(getattr(found, "table", None), Table):
            parts.append(f"### {module.name}\n\n{found.table.markdown()}")
    return "\n\n".join(parts)


def regenerated(text: str) -> str:
    """Return the page with its generated parts written anew."""
    for name, content in (("rooms", rooms()), ("tables", tables())):
        block = re.compile(BLOCK.format(name=name), re.DOTALL)
        assert block.search(text), f"no part `{name}` in {PAGE.name}"
        text = block.sub(lambda found, content=content: f"{found[1]}{content}\n{found[2]}", text)
    return text


if __name__ == "__main__":
    PAGE.write_text(regenerated(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
