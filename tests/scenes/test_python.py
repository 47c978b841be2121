"""The whole job in Python: what `run`, `check` and `resume` take, what they raise, and what a Run gives on."""

import os
import signal
import subprocess
import sys
import threading
from html import escape
from pathlib import Path

import numpy as np
import pytest
import thirdbody
from thirdbody.errors import Fault, InputError, Interrupted, OutputError, ThirdbodyWarning, UsageError
from thirdbody.jit import cache
from thirdbody.laws import generated

BALLS = {
    "title": "two balls",
    "materials": {"steel": {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": np.int64(7850)}},
    "pairs": [{"between": ["steel", "steel"], "friction": 0.3, "restitution": 0.6}],
    "debris": [{
        "material": "steel", "kind": "spheres", "radius": np.float32(5e-6),
        "positions": np.array([[10e-6, 10e-6, 5e-6], [40e-6, 10e-6, 5e-6]]),
    }],
    "domain": {"size": np.array([60e-6, 60e-6])},
    "plates": {
        "lower": {"material": "steel"},
        "upper": {"material": "steel", "support": "load_per_particle", "load": 1e-5, "motion": {"x": {"velocity": 1.0}}},
    },
    "effects": {"gravity": np.array([0.0, 0.0, -9.81])},
    "solver": {"distance": 20e-9},
    "output": {"every": 10e-9, "every_kind": "distance"},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with thirdbody.run(BALLS, tmp_path_factory.mktemp("balls") / "run", 1, progress=False) as run:
        yield run


def test_numbers_in_python_are_in_si():
    scene = thirdbody.Scene(**BALLS)
    assert scene.solver.distance == 20e-9
    assert scene.debris[0].positions[1] == (40e-6, 10e-6, 5e-6)
    further = scene.with_settings({"solver.distance": 40e-9, "domain.size": np.array([80e-6, 60e-6]), "debris.0.radius": 4e-6})
    assert (further.solver.distance, further.domain.size, further.debris[0].radius) == (40e-9, (80e-6, 60e-6), 4e-6)
    with pytest.raises(InputError, match="4e-08 has no unit"):
        scene.with_settings({"solver.distance": "4e-8"})  # text is read as in a file


def test_a_path_and_a_dictionary_are_scenes(tmp_path, run, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thirdbody.Scene(**BALLS).save("balls.toml")
    assert thirdbody.Scene.of("balls.toml") == thirdbody.Scene.of(BALLS)
    with thirdbody.run("balls.toml", threads=1, progress=False) as again:
        assert again.path == Path("runs/balls/run.vtkhdf")
        np.testing.assert_array_equal(again.bodies()["position"], run.bodies()["position"])
    with pytest.raises(TypeError, match="path of a scene file or a dictionary, not list"):
        thirdbody.run([BALLS])


def test_check_is_what_the_command_prints_warnings_first(monkeypatch, capsys, tmp_path):
    found = thirdbody.check(BALLS)
    assert next(iter(found)) == "warnings" and found["bodies"] == 2 and found["estimated_wall_time"] > 0.0
    text = str(found)
    assert text.startswith(f"warning: {found['warnings'][0]}\n" if found["warnings"] else "# two balls: 2 bodies")
    assert capsys.readouterr().out == "" and "law three_spot, level mindlin" in text
    assert repr(found) == f"<Check of 'two balls': 2 bodies, {len(found['warnings'])} warning(s)>"
    assert callable(thirdbody.check), "the module of the function may not take its name"


def test_what_exists_and_remedies_are_told_in_the_words_of_the_reader(run):
    folder = run.path.parent
    with pytest.raises(OutputError, match=r"overwrite=True replaces it, out=\.\.\. names another folder") as refused:
        thirdbody.run(BALLS, folder)
    assert "--" not in str(refused.value)
    assert refused.value.for_command_line().endswith("--overwrite replaces it, -o names another folder")
    fault = Fault("solver.time_step", "is too long", python="; force=True", command="; --force")
    error = InputError([fault, fault])
    assert str(error).count("force=True") == 2 and "--force" not in str(error)
    assert error.for_command_line() == "solver.time_step: is too long; --force\nsolver.time_step: is too long; --force"


def test_ctrl_c_writes_a_checkpoint_and_resume_takes_the_run(tmp_path):
    pressed = []

    def press(progress):
        if progress.frame == 2 and not pressed:
            pressed.append(True)
            os.kill(os.getpid(), signal.SIGINT)

    left = signal.signal(signal.SIGINT, signal.default_int_handler)  # a program's own handler would stay in place
    scene = thirdbody.Scene(**BALLS).with_settings({"solver.distance": "0.2 um", "output.every": "50 nm"})
    with pytest.raises(Interrupted, match=r"frames are kept; to go on: thirdbody\.resume\('"):
        thirdbody.run(scene, tmp_path / "run", 1, progress=press)
    assert signal.signal(signal.SIGINT, left) is signal.default_int_handler
    with thirdbody.open(tmp_path / "run") as part:
        assert 2 <= part.frames < 6 and "resume" not in part.summary()["stopped"]
        with thirdbody.resume(part, threads=1, progress=False) as whole:
            assert whole.summary()["finished"] and whole.frames == 6


@pytest.mark.parametrize(("wrong", "message"), [
    ({"progress": "yes", "overwrite": "no"}, "overwrite = 'no': must be True or False; progress = 'yes': must be True, False or"),
    ({"plugins": "law.py"}, r"plugins = 'law.py': must be a tuple of paths, such as \('law.py',\)"),
    ({"threads": "two"}, "threads = 'two': must be a whole number"), ({"threads": True}, "threads = T"), ({"force": 1}, "force"),
])  # fmt: skip
def test_wrong_types_are_refused_before_anything_is_written(wrong, message, tmp_path):
    with pytest.raises(UsageError, match=message):
        thirdbody.run(BALLS, tmp_path / "run", **wrong)
    assert not list(tmp_path.iterdir())


def test_python_and_the_log_warn_of_what_the_command_warns_of(tmp_path, command):
    """Before the run and at its end; also in `Run.warnings`, the table of a notebook and the log of the run."""
    scene = thirdbody.Scene(**BALLS).with_settings({"plates.upper.load": "1 mN", "pairs.0.friction": 3.0})
    scene.save(tmp_path / "balls.toml")
    with pytest.warns(ThirdbodyWarning) as given:
        run = thirdbody.run(tmp_path / "balls.toml", tmp_path / "run", 1, progress=False)
    texts = [str(warning.message) for warning in given]
    assert texts == run.warnings == run.summary()["warnings"] and {warning.filename for warning in given} == {__file__}
    assert any("friction" in text for text in texts) and any(text.startswith("peak pressure") for text in texts)
    log = (tmp_path / "run" / "run.log").read_text(encoding="utf-8")
    printed = command("run", "balls.toml", "-o", "again", "--threads", 1, "-q").err
    table = run._repr_html_()
    for text in texts:
        assert f"warning: {text}\n" in printed and f"warning: {text}\n" in log and escape(text) in table
    assert len(run) == run.frames == 4 and run.scene.pairs[0].friction == 3.0
    assert " two balls begins\n" in log and log.index(" 100 %") < log.index("finished") < log.rindex("peak pressure")


def test_unknown_names_are_answered_with_the_nearest(run):
    for read, near in (
        (lambda: run.series["fricton_coefficient"], "friction_coefficient"), (lambda: run.units["tme"], "time"),
        (lambda: run.bodies(-1)["positon"], "position"), (lambda: run.array("contacts", "normal_forces"), "normal_force"),
        (lambda: run.block("sphere"), "spheres"),
    ):  # fmt: skip
        with pytest.raises(KeyError, match=f"did you mean .*'{near}'"):
            read()


def test_render_export_and_pyvista_which_gets_every_array_with_its_unit(run, tmp_path):
    assert run.render(tmp_path / "page.html", color="speed").read_text().startswith("<!DOCTYPE html>")
    assert tmp_path / "csv" / "series.csv" in run.export(csv=tmp_path / "csv")
    blocks = run.to_pyvista(-1)
    assert blocks.keys() == ["spheres", "clumps", "contacts", "plates"]
    for name in ("spheres", "clumps", "contacts"):
        arrays = run.block(name)
        np.testing.assert_allclose(blocks[name].points, arrays.pop("position"), rtol=1e-6)  # pyvista may keep float32
        assert set(blocks[name].point_data.keys()) == set(arrays)
        for key, values in arrays.items():
            np.testing.assert_array_equal(blocks[name].point_data[key], values)
    assert len(blocks["contacts"].points) == 4 and blocks["plates"].n_cells == 2
    units = {f"{name}.{key}": blocks[name].field_data[f"{key}_units"][0] for name, key in (
        ("contacts", "normal_force"), ("clumps", "torque"), ("clumps", "velocity"), ("spheres", "radius"),
    )}  # fmt: skip
    assert list(units.values()) == ["N", "N m", "m/s", "m"]
    assert blocks.field_data["time"][0] == run.times[-1] and list(blocks.field_data["state_names"]) == run.state_names
    frame = next(number for number in range(run.frames) if not len(run.contacts(number)["body"]))
    contacts = run.to_pyvista(frame)["contacts"]  # arrays of no rows
    assert contacts.n_points == 0 and contacts["normal_force"].shape == (0,) and contacts["force"].shape == (0, 3)
    assert contacts.field_data["normal_force_units"][0] == "N"


def test_only_public_names_are_listed():
    names = {"Run", "Scene", "Sweep", "check", "compare", "errors", "open", "resume", "run", "sweep"}
    listed = subprocess.run([sys.executable, "-c", "import thirdbody; print(*dir(thirdbody))"], capture_output=True, text=True)
    assert set(listed.stdout.split()) == names | {"__version__", "balance"}
    assert set(thirdbody.__all__) == names and (Path(thirdbody.__file__).parent / "py.typed").is_file()


# several simulations in one process at once

FLAKES = Path(__file__).parents[2] / "scenes" / "sliding_flakes.toml"
FIRST_RUNS = """
import asyncio, sys, threading
from pathlib import Path
import thirdbody

settings = {"debris.0.count": "4", "solver.settle": "1 us", "solver.distance": "20 nm", "output.every": "20 nm"}
scene, folder = thirdbody.Scene.load(sys.argv[1]).with_settings(settings), Path(sys.argv[2])
start = threading.Barrier(3)

def first(number, threads):
    start.wait()
    return thirdbody.run(scene, folder / str(number), threads, progress=False)

async def all_at_once():
    return await asyncio.gather(*(asyncio.to_thread(first, k, threads) for k, threads in enumerate((1, 1, None))))

contents = [b"".join(run.array("clumps", name).tobytes() for name in run.bodies()) for run in asyncio.run(all_at_once())]
assert len(contents[0]) > 1000 and len(set(contents)) == 1, "threads differ"
"""


@pytest.mark.full(kind="slow")
def test_first_runs_in_threads_of_one_process_give_the_same_bits(tmp_path):
    process = subprocess.run([sys.executable, "-c", FIRST_RUNS, FLAKES, tmp_path], capture_output=True, text=True)
    assert process.returncode == 0, process.stderr


def test_a_thread_waits_until_another_has_imported_the_same_generated_module(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "folder", lambda: tmp_path)
    text = "import time\ntime.sleep(0.3)\nlaw = 1\n"
    found = []

    def load():
        found.append(getattr(generated.load_module("slow", text, [])[0], "law", "was not there yet"))

    threads = [threading.Thread(target=load) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [1, 1]
