"""The example notebook runs as it is shipped, without its outputs, and shows what it promises."""

from __future__ import annotations

import ctypes.util
import shutil
from pathlib import Path

import pytest
from portable import PATIENCE

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")

SCENES = Path(__file__).resolve().parents[2] / "scenes"
NOTEBOOK = SCENES / "explore_a_run.ipynb"


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """The code cells after they ran in a copy of the folder: last output by its kinds, in order of the cells."""
    folder = tmp_path_factory.mktemp("scenes")
    shutil.copy(SCENES / "sheared_debris.toml", folder)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=int(PATIENCE), resources={"metadata": {"path": str(folder)}}).execute()
    assert (folder / "runs" / "explore_a_run" / "run.vtkhdf").is_file()
    return [(cell.source, cell.outputs) for cell in notebook.cells if cell.cell_type == "code"]


def shown(cells, start: str) -> dict[str, str]:
    """What the cell whose last line starts so shows, by kind."""
    outputs = next(outputs for source, outputs in cells if source.splitlines()[-1].startswith(start))
    assert not [part for part in outputs if part.output_type == "stream"], "a warning or a print"
    return outputs[-1].data


def test_it_is_stored_without_outputs():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.outputs or cell.execution_count for cell in notebook.cells if cell.cell_type == "code")


def test_a_run_shows_its_summary(cells):
    html = shown(cells, "run")["text/html"].replace("\N{NO-BREAK SPACE}", " ")
    assert "100 irregular steel particles" in html and "sliding distance" in html and "6 \N{MICRO SIGN}m" in html
    drawable = ctypes.util.find_library("EGL") or ctypes.util.find_library("OSMesa")
    assert ("data:image/png;base64," in html) if drawable else ("No picture" in html)


def test_states_and_series_are_those_of_the_scene(cells):
    counts = eval(shown(cells, "{name: np.count_nonzero")["text/plain"])
    assert set(counts) == {"free", "sticking", "sliding", "rolling"}
    assert all(sum(row) == 100 for row in zip(*counts.values(), strict=True))
    friction = eval(shown(cells, "run.friction.to_dict")["text/plain"], {"nan": float("nan")})
    assert 0.0 < friction["value"] < 0.3  # between all rolling and all sliding


def test_pages_tables_and_picture_are_shown(cells):
    pages = [shown(cells, start) for start in ("run.plot()", "run.plot(panels")]
    assert all(len(page["image/png"]) > 30_000 for page in pages)  # blank ones of this size take 10 kB
    assert len(pages[0]["image/png"]) > len(pages[1]["image/png"])
    assert "normal_force" in shown(cells, "shown")["text/html"]
    assert set(shown(cells, "picture")) & {"image/png", "text/plain"}
