"""The command line itself: its help, options, unknown commands, completion in shells; what is installed to start from."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from portable import PATIENCE
import thirdbody
from thirdbody import atomic_files
from thirdbody.cli import main, starter_files
from thirdbody.cli.command_group import REMOVED_COMMANDS, REMOVED_OPTIONS
from thirdbody.errors import ThirdbodyWarning
from thirdbody.laws.registry import load_file
from thirdbody.runner.run_loop import WallTimes
from thirdbody.studies.copies import StudySource
from thirdbody.studies.cost_command import StudyOptions
from thirdbody.studies.sweep import Execution

COMMANDS = (
    "balance", "check", "compare", "cost", "export", "laws", "map", "new", "plot", "render", "resume", "run", "shapes", "states",
    "sweep",
)  # fmt: skip


def test_help_speaks_of_files_and_numbers_not_of_types_of_python(command):
    for name in COMMANDS:
        report = command(name, "--help")
        assert report.code == 0 and report == command(name, "-h")
        types = r"<(?!scene)[^>]*>|\b(?:TEXT|INTEGER|FLOAT|RANGE|list\[)"  # runs/<scene name> may stay
        assert not re.findall(types, report.out) and "--install-completion" not in report.out  # an option of `thirdbody` alone
    assert command("-h") == command("--help")


def test_version_the_same_program_as_a_module_and_unknown_commands(command):
    assert command("-V") == command("--version") == (0, f"thirdbody {thirdbody.__version__}\n", "")
    done = subprocess.run([sys.executable, "-m", "thirdbody", "run", "--help"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("Usage: thirdbody run")
    report = command("quux")
    assert report.code == 2 and "no command 'quux'" in report.err and all(name in report.err for name in COMMANDS)
    report = command("blance")
    assert report.code == 2 and report.err == "thirdbody: no command 'blance', did you mean 'balance'?\n"


def test_what_is_gone_is_answered_with_what_does_its_job(balls, command, tmp_path):
    balls()
    rows = [((name,), name, text) for name, text in REMOVED_COMMANDS.items()]
    for (name, option), text in REMOVED_OPTIONS.items():
        rows += [((name, "scene.toml", option, "4"), option, text), ((name, "scene.toml", f"{option}=4"), option, text)]
    for words, name, text in rows:
        assert command(*words) == (2, "", f"thirdbody: {name}: {text}\n")
    assert "--effects" in command("cost", "scene.toml", "--verify").err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_memory_that_runs_out_is_no_bug(command, monkeypatch):
    def fail(**_options):
        raise MemoryError("Unable to allocate 8.00 GiB")

    monkeypatch.setattr(main, "app", fail)
    assert command("laws") == (5, "", "thirdbody: not enough memory (Unable to allocate 8.00 GiB)\n")


def test_a_time_without_a_unit_is_not_guessed(balls, command):
    balls()
    for option in ("--wall-limit", "--checkpoint-every"):
        wanted = "expected a unit of time (ps, ns, us, ms, s, min, h)"
        assert command("run", "scene.toml", option, "5").err == f"thirdbody: {option}: 5 has no unit, {wanted}\n"


def test_every_option_reaches_what_it_sets(balls, command, monkeypatch):
    balls()
    told, plugins = [], [Path("p.py")]
    lines = """\
run scene.toml -o out --threads 1 --checkpoint-every 2_s --wall-limit 3_s --overwrite -q --json
render run -o x.gif --color speed --view top --forces --body 2 --plate upper --cycles 3 --zoom 0.5 --width 300 --frame 3 --fps 7\
 --frames 1:2 --height 400 --camera fixed
cost s.toml --set a=1 --plugin p.py --repeats 5 --budget 2_min --effects --only b --only c --overwrite --quiet --json
sweep scene.toml -o out --plugin p.py --vary a=1 --set b=3 --design zip --samples 8 --result load --keep summary -q --json\
 --dry-run --retry failed --workers 2"""
    for place in ("runner.simulate.execute", "report.tables.run_report", "render.render.render",
                  "studies.cost_command.cost_command", "studies.sweep.sweep_command"):  # fmt: skip
        monkeypatch.setattr(f"thirdbody.{place}", lambda *words, **keys: told.append((*words, keys)))
    monkeypatch.setattr("thirdbody.studies.sweep.plan_of_options", lambda *words: (words, "the folder"))
    for line in lines.splitlines():
        assert command(*(word.replace("_", " ") for word in line.split())).code == 0, line
    (_, *ran, keys), reported, drawn, studied, swept = told
    assert ran == [Path("out"), 1, None] and (keys["overwrite"], keys["times"]) == (True, WallTimes(2.0, 3.0))
    picture = {"color": "speed", "view": "top", "forces": True, "body": 2, "plate": "upper", "cycles": 3.0, "zoom": 0.5,
               "frame": 3, "size": (300, 400), "frames": "1:2", "fps": 7, "camera": "fixed", "progress": True}  # fmt: skip
    assert reported == (Path("out"), True, {}) and drawn == (Path("run"), Path("x.gif"), picture)
    source = StudySource(Path("s.toml"), {"a": "1"}, Path("runs/s_effects"), plugins)
    assert studied[:4] == (source, StudyOptions(5, True, 120.0, ("b", "c")), True, True)
    options = {"design": "zip", "samples": 8, "results": ["load"], "keep": "summary", "settings": {"b": 3}}
    points = (Path("scene.toml"), Path("out"), ["a=1"], options, plugins)
    assert swept == (points, "the folder", Execution(None, 2, True, True), True, True, True, {})


def test_more_threads_than_cores_are_capped_with_a_word(balls, command, tmp_path):
    scene = thirdbody.Scene.load(balls())
    report = command("run", "scene.toml", "-o", "run", "--threads", "100000")
    assert report.code == 0 and "warning: 100000 threads were requested" in report.err
    for threads, capped in ((1, False), (100000, True)):
        with pytest.warns(ThirdbodyWarning) as given:
            thirdbody.run(scene, tmp_path / str(threads), threads, progress=False)
        assert any("threads were requested" in str(warning.message) for warning in given) == capped


@pytest.fixture
def home(tmp_path):
    program = tmp_path / "bin" / "thirdbody"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m thirdbody "$@"\n')
    program.chmod(0o755)
    return {**os.environ, "HOME": str(tmp_path), "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}


def shell(name, script, home):
    if not shutil.which(name):
        pytest.skip(f"no {name} here")
    words = [name, "-f"] if name == "zsh" else [name]
    done = subprocess.run([*words, "-c", script], env=home, cwd=home["HOME"], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    return done.stdout


BASH = """
asked() { COMP_WORDS=(thirdbody "$@"); COMP_CWORD=$#; COMPREPLY=(); _thirdbody_completion thirdbody; echo "${COMPREPLY[@]}"; }
asked re
asked balance --le
asked run scene.toml --over
asked new --from fre
asked run --install
"""


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("how", ['eval "$(thirdbody --show-completion)"', "thirdbody --install-completion; source ~/.bashrc"])
def test_bash_completes_commands_and_options(how, home):
    lines = [set(line.split()) for line in shell("bash", f"{how}\n{BASH}", home).splitlines()[-5:]]
    assert lines == [{"resume", "render"}, {"--level"}, {"--overwrite"}, {"fretting", "fretting_rig"}, set()]


def test_fish_completes_commands_and_options(home):
    script = "thirdbody --show-completion | source; complete -C 'thirdbody balance --le'"
    assert shell("fish", script, home).split()[0] == "--level"
    shell("fish", "thirdbody --install-completion", home)
    assert "thirdbody" in (Path(home["HOME"]) / ".config" / "fish" / "completions" / "thirdbody.fish").read_text()


def test_zsh_completes_when_it_loads_the_function_too(home):
    shell("zsh", "thirdbody --install-completion; true", home)
    text = (Path(home["HOME"]) / ".zfunc" / "_thirdbody").read_text()
    assert text.splitlines()[0] == "#compdef thirdbody" and text.count("loadautofunc") == 1
    stand_ins = "compdef() { }; _arguments() { print -r -- $1 }; words=(thirdbody re); CURRENT=2"
    assert "resume" in shell("zsh", f"fpath+=~/.zfunc; {stand_ins}; autoload -Uz _thirdbody; _thirdbody", home)


def test_completion_that_cannot_be_installed_is_reported_in_one_line(home, tmp_path):
    (tmp_path / ".bash_completions").write_text("a file where a folder has to be")
    done = subprocess.run(["bash", "-c", "thirdbody --install-completion; exit $?"], env=home, capture_output=True, text=True)
    assert done.returncode == 5 and done.stderr.count("\n") == 1 and ".bash_completions" in done.stderr


NO_USER = "import pwd\ndef unknown(user):\n    raise KeyError(user)\npwd.getpwuid = unknown\n"


def test_completion_without_a_home_is_reported_in_one_line(home, tmp_path):
    """As in a container that runs under the number of an unknown user. (Other shells than bash set HOME themselves.)"""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(NO_USER)
    bare = {key: value for key, value in home.items() if key != "HOME"} | {"PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        ["bash", "-c", "thirdbody --install-completion; exit $?"], env=bare, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 5 and done.stderr.count("\n") == 1 and "this user has none: set HOME" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "site"]


def test_completion_in_an_unknown_shell_is_refused_with_those_that_work(home, tmp_path):
    other = tmp_path / "bin" / "dash"
    other.symlink_to(shutil.which("sh"))
    done = subprocess.run([str(other), "-c", "thirdbody --show-completion; exit $?"], env=home, capture_output=True, text=True)
    assert done.returncode == 2 and "bash, zsh and fish" in done.stderr and done.stdout == ""


ROOT = Path(__file__).resolve().parents[2]
SCENES = {path.relative_to(ROOT / "scenes").with_suffix("").as_posix(): path for path in (ROOT / "scenes").rglob("*.toml")}
SWEEPS = [name for name, path in SCENES.items() if "sweep" in tomllib.loads(path.read_text(encoding="utf-8"))]


def test_every_shipped_scene_is_listed_with_its_question_and_can_be_copied(command, tmp_path):
    report = command("new", "--list")
    lines = {line.split()[0]: line for line in report.out.splitlines() if line}
    for name, path in SCENES.items():
        assert path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ") in lines[name]
    rows = json.loads(command("new", "--list", "--json").out)
    assert {row["name"] for row in rows} == SCENES.keys() and all("?" in row["question"] for row in rows)
    # a copy has all that the scene needs
    for name, path in SCENES.items():
        mine = f"{name.replace('/', '_')}.toml"
        report = command("new", mine, "--from", name)
        assert report.code == 0 and report.out.startswith(mine)
        assert (tmp_path / mine).read_bytes() == path.read_bytes().replace(b'"../', b'"')
        if name in SWEEPS:
            scene = tomllib.loads((tmp_path / mine).read_text(encoding="utf-8"))["scene"]
            assert Path(scene).name == scene and (tmp_path / scene).is_file()
        kind = "balance" if name.startswith("balance/") else "sweep --dry-run" if name in SWEEPS else "check"
        assert f"next: thirdbody {kind} {mine}" in report.out
        scene = thirdbody.Scene.load(mine) if kind == "check" else None
        for debris in scene.debris if scene else ():
            assert not hasattr(debris, "file") or scene.beside(debris.file).is_file()


@pytest.mark.full(kind="slow")
@pytest.mark.parametrize("name", SWEEPS)
def test_a_copy_of_a_sweep_can_be_planned(name, command):
    assert command("new", "mine.toml", "--from", name).code == 0
    assert command("sweep", "--dry-run", "mine.toml").code == 0


def test_a_file_that_a_scene_needs_is_copied_once_whole_or_not_at_all_and_never_over_another(command, tmp_path, monkeypatch):
    assert command("new", "--from", "scanned_debris.toml").code == 0
    mesh = tmp_path / "debris_particle.stl"
    assert mesh.read_bytes() == (ROOT / "scenes" / "debris_particle.stl").read_bytes()
    report = command("new", "again.toml", "--from", "scanned_debris")
    assert report.code == 0 and "stl" not in report.out
    mesh.write_bytes(b"my own")
    report = command("new", "third.toml", "--from", "scanned_debris")
    assert report.code == 5 and "debris_particle.stl: exists already" in report.err
    assert mesh.read_bytes() == b"my own" and not (tmp_path / "third.toml").exists()

    def full(path, content):
        if path.suffix == ".stl":
            raise OSError(28, "No space left on device")
        path.write_bytes(content)

    monkeypatch.setattr(atomic_files, "write_whole", full)
    (tmp_path / "full").mkdir()
    with pytest.raises(starter_files.OutputError, match="debris_particle.stl: cannot be written .No space left"):
        starter_files.copy_scene("scanned_debris", tmp_path / "full" / "x.toml")
    assert not any((tmp_path / "full").iterdir())


def test_a_plug_in_to_start_from(command, tmp_path):
    report = command("new", "--plugin", "sticky.py")
    assert report.code == 0 and "next: thirdbody laws --check sticky.py" in report.out
    assert (tmp_path / "sticky.py").read_bytes() == (ROOT / "plugins" / "dmt_adhesion.py").read_bytes()
    assert load_file(tmp_path / "sticky.py").effects
    assert command("new", "--plugin", "sticky.py").code == 5


def test_calls_that_cannot_work(command, tmp_path):
    for *arguments, message in (
        ("--from", "freting", "--from freting: no such scene, did you mean 'fretting'?"),
        ("--from", "../plugins/x", "no such scene"),
        ("--from", "fretting", "--plugin", "give one of them"),
        ("--json", "only with --list"),
    ):
        done = command("new", "x.toml", *arguments)
        assert done.code == 2 and message in done.err and done.err.count("\n") == 1 and not list(tmp_path.iterdir())


@pytest.mark.full(kind="slow")
def test_a_wheel_carries_them_and_no_pictures(tmp_path):
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("src", "plugins", "scenes"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
    build = "from setuptools.build_meta import build_wheel; build_wheel('.')"
    subprocess.run([sys.executable, "-c", build], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"thirdbody_scenes/{name}.toml" for name in SCENES} <= set(names)
    assert {"thirdbody_scenes/debris_particle.stl", "thirdbody_template/dmt_adhesion.py", "thirdbody/__main__.py"} <= set(names)
    assert not [name for name in names if name.endswith((".png", ".ipynb"))]
