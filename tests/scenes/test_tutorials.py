"""The tutorials run as they are shipped, show what their text says, and their stored outputs are small."""

import ast
import base64
import json
import re

import pytest

pytest.importorskip("nbclient")
pytest.importorskip("pandas")
pytest.importorskip("SALib")

from each import each
from pages import ROOT
from tutorials import NOTEBOOKS, PNG, executed
import thirdbody

KILOBYTES = 150
# What the text of a notebook says about its results. Margins: other compilers change last bits, and a body near the edge of two
# seats may take the other one, so fractions of bodies have room for a few of them.
CLAIMS = {
    "1_first_scene": """
        assert 0.20 < run.friction.value < 0.26 and 0.7 < run.series["fraction_rolling"].max() < 0.95
        assert all(low[1] < high[1] for low, high in zip(rows, rows[1:])) and all(row[1] < row[0] for row in rows)
        assert rows[0][3] < 0.35 and rows[-1][3] > 0.85
    """,
    "2_reading_a_run": """
        assert table.loc["hard grains", "share of the load"] > 0.5 > 0.3 > table.loc["hard grains", "share of the friction work"]
        grains = bodies[bodies["population_name"] == "hard grains"]
        assert (grains["state_name"] == "rolling").mean() > 0.9
        medians = bodies.groupby("state_name")[["diameter", "margin_rotation"]].median()
        assert medians["diameter"].idxmin() == "free" and medians["margin_rotation"]["rolling"] < 0.0
    """,
    "3_my_particles": """
        assert rows[0][2] < rows[1][2] < rows[2][2] and abs(rows[2][2] - rows[3][2]) < 0.12
        assert set(bodies[bodies["shape"] == "plate"]["state_name"]) == {"sliding"}
        assert np.abs(np.array(work) / (0.3 * 0.1e-3 * 4e-6) - cosine).max() < 0.05
    """,
    "4_fretting_and_wear": """
        assert 10 < half < 27 and report["integrator"] == "implicit" and len(run.cycles["energy"]) == 4
        shares = [run.series[f"energy_{part}"][-1] / work for part in parts]
        assert shares[0] > 0.9 and abs(shares[2]) < 0.01 and abs(shares[3]) < 1e-3
        assert bodies[["slides", "friction_work"]].corr().iloc[0, 1] > 0.9
    """,
    "5_my_own_law": """
        assert all(abs(measured - estimate) < 1e-4 for _, measured, estimate in rows) and rows[2][1] > 0.22
    """,
    "6_how_accurate": """
        errors = {name: np.nanmax(np.abs(values - reference)[before]) for name, values in curves.items()}
        assert errors["mdr, 8 springs"] < 0.05 * errors["mindlin"] and errors["mindlin"] < errors["coulomb"]
        steps, values = zip(*mean.values(), strict=True)
        assert sorted(steps) == list(steps) and abs(values[2] / values[-1] - 1.0) < 1e-3
    """,
    "7_a_sweep": """
        assert (table["status"] == "done").all() and np.all(rolls == (ratio > np.sqrt(1.0 + friction**2) - friction))
        low, _, high = rolling["mean"].groupby(level=1).mean()
        assert low < 0.45 and high > 0.9 and (seeds.to_pandas()["status"] == "done").all()
    """,
    "8_which_input_matters": """
        size = {result: frame["mu_star"].astype(float) for result, frame in effects.items()}
        for decides in ("pairs.0.friction", "debris.0.aspect.2"):
            assert size["friction_coefficient"][decides] > 2.0 * size["friction_coefficient"]["debris.0.angularity"]
            assert size["fraction_rolling"][decides] > 2.0 * size["fraction_rolling"]["debris.0.angularity"]
        assert size["friction_coefficient"]["plates.upper.load"] < 0.02
    """,
    "9_calibration": """
        assert abs(fit.x - 0.37) < 0.04 and fit.fun < 0.025 and len(tried) <= 12
    """,
}


def test_every_notebook_is_listed():
    assert [path.stem for path in NOTEBOOKS] == sorted(CLAIMS)
    page = (ROOT / "scenes" / "README.md").read_text(encoding="utf-8")
    assert all(f"(tutorials/{path.name})" in page for path in NOTEBOOKS)


@pytest.mark.full(kind="slow")  # what they show is shown by tests of plug-ins, meshes, levels, strokes and sweeps
@pytest.mark.parametrize("name", CLAIMS)
def test_it_runs_and_shows_what_it_says(name, tmp_path):
    path = NOTEBOOKS[0].with_name(f"{name}.ipynb")
    notebook = executed(path, tmp_path, re.sub(r"^ {8}", "", CLAIMS[path.stem], flags=re.MULTILINE))  # raises for a failing cell
    for cell, before in zip(notebook.cells[:-1], json.loads(path.read_text(encoding="utf-8"))["cells"], strict=True):
        # what a run warns of, which the stored pages leave out
        outputs = [output for output in cell.get("outputs", []) if ": ThirdbodyWarning: " not in output.get("text", "")]
        assert [output.output_type for output in outputs] == [output["output_type"] for output in before.get("outputs", [])]
        assert not [output.text for output in outputs if output.output_type == "stream" and output.name == "stderr"]


@each(NOTEBOOKS)
def test_its_pictures_are_stored_and_small(path):
    text = path.read_text(encoding="utf-8")
    outputs = [output for cell in json.loads(text)["cells"] for output in cell.get("outputs", [])]
    pictures = ["".join(output["data"]["image/png"]) for output in outputs if "image/png" in output.get("data", {})]
    pictures += [found[1] for found in PNG.findall("".join("".join(o.get("data", {}).get("text/html", "")) for o in outputs))]
    assert pictures or path.stem.startswith("5"), "no outputs are stored: python tests/tutorials.py"
    assert all(len(base64.b64decode(picture)) < 1000 * KILOBYTES for picture in pictures) and len(text) < 300_000


@each(NOTEBOOKS)
def test_its_cells_are_python_of_public_names_and_its_links_exist(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    for node in ast.walk(ast.parse("\n".join(re.sub(r"^[!%].*", "", text, flags=re.MULTILINE) for text in code))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "thirdbody":
            assert hasattr(thirdbody, node.attr), node.attr
    for cell in cells:
        for target in re.findall(r"\]\(([^)#]+)\)", "".join(cell["source"])) if cell["cell_type"] == "markdown" else ():
            assert (path.parent / target).exists(), target
