"""The notebooks of scenes/tutorials: `python tests/tutorials.py [NAME ...]` runs them anew and stores their outputs."""

import base64
import io
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any
from unittest.mock import patch

import nbclient
import nbformat
from pages import ROOT
from PIL import Image
from portable import PATIENCE

SCENES = ROOT / "scenes"
NOTEBOOKS = sorted((SCENES / "tutorials").glob("*.ipynb"))
PNG = re.compile(r"(data:image/png;base64,)([A-Za-z0-9+/=]+)")
FRAME = re.compile(r"<iframe.*?</iframe>", re.DOTALL)
WIDTH = 900


def executed(path: Path, folder: Path, then: str = "") -> Any:
    """A notebook after it ran in a copy of the scenes in `folder`, and after it a cell with the code `then`."""
    place = folder / "scenes" / "tutorials"
    place.mkdir(parents=True)
    for file in (*SCENES.glob("*.toml"), *SCENES.glob("*.stl"), *SCENES.glob("sweeps/*.toml")):
        target = place.parent / file.relative_to(SCENES)
        target.parent.mkdir(exist_ok=True)
        shutil.copy(file, target)
    notebook = nbformat.read(path, as_version=4)
    if then:
        notebook.cells.append(nbformat.v4.new_code_cell(then))
    resources = {"metadata": {"path": str(place)}}
    path_with_us = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # where `thirdbody` is
    with patch.dict(os.environ, PATH=path_with_us):
        nbclient.NotebookClient(notebook, timeout=int(PATIENCE), kernel_name="python3", resources=resources).execute()
    return notebook


def with_small_pictures(notebook: Any) -> Any:
    """The notebook with pictures at most WIDTH wide and of 256 colours, without pages of runs and times of execution."""
    for cell in notebook.cells:
        cell.metadata = {}
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "image/png" in data:
                data["image/png"] = _small(data["image/png"])
            if "text/html" in data:
                data["text/html"] = FRAME.sub("", data["text/html"])
    return notebook


def _small(picture: str) -> str:
    image = Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.quantize(256, kmeans=8, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


if __name__ == "__main__":
    for notebook_path in NOTEBOOKS:
        if not sys.argv[1:] or notebook_path.stem in sys.argv[1:]:
            with tempfile.TemporaryDirectory() as work:
                nbformat.write(with_small_pictures(executed(notebook_path, Path(work))), notebook_path)
