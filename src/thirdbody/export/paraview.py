"""Files for ParaView next to `run.vtkhdf`: one sidecar per block, and a script that sets up the view."""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from string import Template

from thirdbody.atomic_files import write_whole
from thirdbody.palette import rgb, state_colors
from thirdbody.trajectory.names import BLOCKS
from thirdbody.trajectory.writer import FORMAT

SCRIPT_NAME = "open_in_paraview.py"

_SCRIPT = Template('''"""Shows this run in ParaView $version or later.

Tools > Run Script..., or `pvpython $script [picture.png]`.
"""
import os
import sys

from paraview.simple import *

STATES = $states
COLORS = $colors
FILES = "$files"
MAPS = $maps

folder = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else os.getcwd()
picture = sys.argv[1] if len(sys.argv) > 1 and sys.argv[1].endswith(".png") else None


def block(name):
    path = os.path.join(folder, FILES.replace("{name}", name))
    if not os.path.exists(path):
        raise SystemExit("not found: " + path + " (run this script from the folder of the run)")
    return OpenDataFile(path, registrationName=name)


view = GetActiveViewOrCreate("RenderView")
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]

spheres = block("spheres")
shown = Show(spheres, view)
shown.SetRepresentationType("Point Gaussian")
shown.ShaderPreset = "Sphere"
shown.ScaleByArray = 1
shown.SetScaleArray = ["POINTS", "radius"]
shown.UseScaleFunction = 0
shown.GaussianRadius = 1.0
lut = GetColorTransferFunction("state")
lut.InterpretValuesAsCategories = 1
lut.Annotations = [text for code, name in enumerate(STATES) for text in (str(code), name)]
lut.IndexedColors = COLORS
ColorBy(shown, ("POINTS", "state"))
shown.SetScalarBarVisibility(view, True)
bar = GetScalarBar(lut, view)
bar.Title, bar.ComponentTitle = "state", ""
bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]

plates = Show(block("plates"), view)
plates.SetRepresentationType("Surface With Edges")
plates.Opacity = 0.25
plates.ColorArrayName = [None, ""]
plates.DiffuseColor = [0.62, 0.66, 0.72]

# In the pipeline browser, but hidden: the contacts lie inside the bodies, and maps hide them.
for name in ["contacts", "clumps", *MAPS]:
    Hide(block(name), view)

scene = GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
scene.GoToLast()
view.ResetCamera()
camera = GetActiveCamera()
camera.Elevation(-55)
camera.Azimuth(-15)
view.ResetCamera()
Render()
if picture:
    SaveScreenshot(picture, view, ImageResolution=[1600, 900])
''')


def write_sidecars(path: str | Path) -> list[Path]:
    """Write `run.spheres.vtkhdf` and the other sidecars next to the trajectory `path`; return their paths.

    Each holds one external link to a block, so that it reads as plain PolyData: VTK 9.7 ignores the time of composite files. The
    link names the trajectory relative to the folder, which may therefore move. Raises OSError.
    """
    import h5py

    path = Path(path)
    sidecars = []
    for name in BLOCKS:
        sidecar = path.with_name(f"{path.stem}.{name}.vtkhdf")
        content = io.BytesIO()
        with h5py.File(content, "w", libver=FORMAT) as file:
            file["VTKHDF"] = h5py.ExternalLink(path.name, f"/VTKHDF/{name}")
        write_whole(sidecar, content.getvalue())
        sidecars.append(sidecar)
    return sidecars


def write_script(path: Path, state_names: Sequence[str], files: str, maps: Sequence[str] = ()) -> None:
    """Write the script that sets up the view. Raises OSError.

    `files` is the name of the file of a block, as `{name}.pvd`; `maps`: the blocks of the maps of the plates.
    """
    colors = [round(channel / 255.0, 4) for color in state_colors(state_names) for channel in rgb(color)]
    text = _SCRIPT.substitute(
        script=path.name,
        states=json.dumps(list(state_names)),
        colors=json.dumps(colors),
        files=files,
        maps=json.dumps(list(maps)),
        version="5.11" if files.endswith(".pvd") else "5.13",
    )
    write_whole(path, text.encode())


def write_paraview_files(path: str | Path, state_names: Sequence[str]) -> list[Path]:
    """Write sidecars and `open_in_paraview.py` next to the trajectory `path`; return them. Raises OSError."""
    path = Path(path)
    script = path.with_name(SCRIPT_NAME)
    write_script(script, state_names, f"{path.stem}.{{name}}.vtkhdf")
    return [*write_sidecars(path), script]
