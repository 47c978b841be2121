"""The command line itself: its help, short options, unknown commands, completion in shells, limits of options."""

import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from portable import PATIENCE

import thirdbody
from thirdbody.cli import main
from thirdbody.cli.removed import REMOVED_COMMANDS, REMOVED_OPTIONS

COMMANDS = (
    "balance", "check", "cost", "export", "laws", "map", "new", "plot", "render", "resume", "run", "shapes", "states",
    "sweep",
)  # fmt: skip


@pytest.mark.parametrize("name", COMMANDS)
def test_help_speaks_of_files_and_numbers_not_of_types_of_python(name, command):
    report = command(name, "--help")
    assert report.code == 0
    assert not re.findall(r"<(?!scene)[^>]*>|\b(?:TEXT|INTEGER|FLOAT|RANGE|list\[)", report.out)  # runs/<scene name> may stay
    assert "--install-completion" not in report.out  # an option of `thirdbody` alone


@pytest.mark.parametrize("name", [(), *((name,) for name in COMMANDS)], ids=lambda words: " ".join(words) or "thirdbody")
def test_h_is_help(name, command):
    assert command(*name, "-h") == command(*name, "--help")


def test_v_is_version(command):
    assert command("-V") == command("--version")
    assert command("-V").out == f"thirdbody {thirdbody.__version__}\n"


def test_python_m_is_the_same_program():
    done = subprocess.run([sys.executable, "-m", "thirdbody", "run", "--help"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("Usage: thirdbody run")


def test_an_unknown_command_is_answered_with_those_that_exist(command):
    report = command("quux")
    assert report.code == 2 and "no command 'quux'" in report.err and all(name in report.err for name in COMMANDS)
    report = command("blance")
    assert report.code == 2 and report.err == "thirdbody: no command 'blance', did you mean 'balance'?\n"


@pytest.mark.parametrize("words", [*REMOVED_OPTIONS, *((name,) for name in REMOVED_COMMANDS)], ids=" ".join)
def test_what_is_gone_is_answered_with_what_does_its_job(words, balls, command, tmp_path):
    """One message, also where the option has a value, and nothing is written."""
    balls()
    text = REMOVED_OPTIONS[words] if len(words) == 2 else REMOVED_COMMANDS[words[0]]
    for line in ((words[0], "scene.toml", *words[1:], "4"), (words[0], "scene.toml", f"{words[-1]}=4")):
        report = command(*line) if len(words) == 2 else command(*words)
        assert report.code == 2 and report.err == f"thirdbody: {words[-1]}: {text}\n" and not report.out
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


@pytest.mark.parametrize("text", ["", "Unable to allocate 8.00 GiB"])
def test_memory_that_runs_out_is_no_bug(text, command, monkeypatch):
    def fail(**_options):
        raise MemoryError(*filter(None, [text]))

    monkeypatch.setattr(main, "app", fail)
    assert command("laws") == (5, "", f"thirdbody: not enough memory{f' ({text})' if text else ''}\n")


@pytest.mark.parametrize("option", ["--wall-limit", "--checkpoint-every"])
def test_a_time_without_a_unit_is_not_guessed(option, balls, command):
    balls()
    report = command("run", "scene.toml", option, "5")
    wanted = "expected a unit of time (ps, ns, us, ms, s, min, h)"
    assert report.code == 2 and report.err == f"thirdbody: {option}: 5 has no unit, {wanted}\n"


def test_more_threads_than_cores_are_capped_with_a_word(balls, command, tmp_path):
    scene = thirdbody.Scene.load(balls())
    report = command("run", "scene.toml", "-o", "run", "--threads", "100000")
    assert report.code == 0 and "warning: 100000 threads were requested" in report.err
    with pytest.warns(UserWarning, match="100000 threads were requested"):
        thirdbody.run(scene, tmp_path / "again", threads=100_000, progress=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        thirdbody.run(scene, tmp_path / "one", threads=1, progress=False)


# completion ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """The environment of a user whose home is empty, with the command `thirdbody` on the path."""
    program = tmp_path / "bin" / "thirdbody"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m thirdbody "$@"\n')
    program.chmod(0o755)
    return {**os.environ, "HOME": str(tmp_path), "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}"}


def shell(name: str, script: str, home: dict[str, str]) -> str:
    """What a script prints in a shell."""
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
    """An autoloaded function defines itself at the first tab, and has to answer that tab as well."""
    shell("zsh", "thirdbody --install-completion; true", home)
    text = (Path(home["HOME"]) / ".zfunc" / "_thirdbody").read_text()
    assert text.splitlines()[0] == "#compdef thirdbody" and text.count("loadautofunc") == 1
    stand_ins = "compdef() { }; _arguments() { print -r -- $1 }; words=(thirdbody re); CURRENT=2"
    assert "resume" in shell("zsh", f"fpath+=~/.zfunc; {stand_ins}; autoload -Uz _thirdbody; _thirdbody", home)


def test_completion_that_cannot_be_installed_is_reported_in_one_line(home, tmp_path):
    (tmp_path / ".bash_completions").write_text("a file where a folder has to be")
    done = subprocess.run(["bash", "-c", "thirdbody --install-completion; exit $?"], env=home, capture_output=True, text=True)
    assert done.returncode == 5 and done.stderr.count("\n") == 1 and ".bash_completions" in done.stderr


NO_USER = """
import pwd
def unknown(user):
    raise KeyError(user)
pwd.getpwuid = unknown
"""


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
    """A Python that starts the program is no shell; above it there may be one, or none."""
    other = tmp_path / "bin" / "dash"
    other.symlink_to(shutil.which("sh"))
    done = subprocess.run([str(other), "-c", "thirdbody --show-completion; exit $?"], env=home, capture_output=True, text=True)
    assert done.returncode == 2 and "bash, zsh and fish" in done.stderr and done.stdout == ""


def test_an_option_that_is_no_more_is_answered_with_what_does_its_work(command):
    report = command("cost", "scene.toml", "--verify")
    assert report.code == 2 and report.err.count("\n") == 1
    assert report.err.startswith("thirdbody: --verify: ") and "--effects" in report.err
