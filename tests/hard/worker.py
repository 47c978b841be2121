"""A process that answers line by line, started again after it died."""

import json
import select
import subprocess
import sys
from pathlib import Path

from portable import PATIENCE

SECONDS = 30.0  # of the processor


class Worker:
    """Runs `file_mutants.py` in a folder that shows whether anything was written."""

    def __init__(self, folder: Path):
        self.command = [sys.executable, "-W", "ignore", str(Path(__file__).with_name("file_mutants.py"))]
        self.folder, self.process = folder, None

    def request(self, line: str) -> tuple:
        """The answer to a line and what was said; "crash" or "hang" where there was none."""
        if self.process is None:
            quiet = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            self.process = subprocess.Popen(self.command, cwd=self.folder, text=True, **quiet)
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE)
        answer = self.process.stdout.readline() if ready else ""
        if answer:
            report, text, seconds = json.loads(answer)
            return (report, text) if seconds < SECONDS else ("hang", f"{seconds:.0f} s")
        self.close()
        return ("crash", "the worker died") if ready else ("hang", f"more than {PATIENCE:g} s")

    def close(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None
        assert not list(self.folder.iterdir())
