"""Several simulations in one process at once: their first compilation, and the same bits as one after the other."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from thirdbody.jit import cache_dir
from thirdbody.laws.codegen import module_cache
from thirdbody.system.module_import import import_file

SCENE = Path(__file__).parents[2] / "scenes" / "sliding_flakes.toml"
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


def test_first_runs_in_threads_of_one_process_give_the_same_bits(tmp_path):
    process = subprocess.run([sys.executable, "-c", FIRST_RUNS, SCENE, tmp_path], capture_output=True, text=True)
    assert process.returncode == 0, process.stderr


def test_a_thread_waits_until_another_has_imported_the_same_generated_module(tmp_path, monkeypatch):
    monkeypatch.setattr(cache_dir, "folder", lambda: tmp_path)
    text = "import time\ntime.sleep(0.3)\nlaw = 1\n"
    found = []

    def load():
        found.append(getattr(module_cache.load_module("slow", text, [])[0], "law", "was not there yet"))

    threads = [threading.Thread(target=load) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [1, 1]


def test_a_module_that_fails_is_not_taken_for_imported(tmp_path):
    path = tmp_path / "failing.py"
    path.write_text("1 / 0\n")
    with pytest.raises(ZeroDivisionError):
        import_file("thirdbody_test_failing", path)
    assert "thirdbody_test_failing" not in sys.modules
