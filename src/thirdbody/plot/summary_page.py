"""Summary page of a run: panels over the drag, of the contacts at a frame, and a headline in words."""

import io
import os
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from thirdbody.atomic_files import write_whole
from thirdbody.errors import InputError, OutputError, UsageError
from thirdbody.plot import panels_accommodation as accommodation
from thirdbody.plot import panels_bed as bed
from thirdbody.plot import panels_contacts as contacts
from thirdbody.plot import panels_friction as friction
from thirdbody.plot import panels_groups as groups
from thirdbody.plot import panels_profiles as profiles
from thirdbody.plot import panels_series as series
from thirdbody.plot.forecast_plot import DOTS, check_format
from thirdbody.plot.run_data import RunData
from thirdbody.trajectory.reader import Run, open_run
from thirdbody.units import GLUE, MINUS, quantity_text, unit_for

INK, SOFT = "#222222", "#5A626C"
WIDTH = 8.27
"""Width of the page [inch]: A4."""
TITLE_LINE, LINE, NOTE_LINE = 0.27, 0.17, 0.125
"""Heights of lines of text: title, headline, notes [inch]."""
LETTERS_OF_TITLE, LETTERS, LETTERS_OF_NOTE = 62, 116, 145
"""Largest number of letters in such a line, by the width of the page."""
DECIMALS = 8
"""Decimals of the positions of axes, as fractions of the page: far below a pixel."""
EDGE, MARGIN = 0.2, 0.3
"""Free space above and below, and to the left [inch]."""


class Panel(NamedTuple):
    """Panel: condition, title, drawing."""

    name: str
    missing: Callable[[RunData], str]
    """Why the run has no data for it, empty if it has."""
    title: Callable[[RunData], str]
    draw: Callable[[Axes, RunData], None]
    height: float
    """Height with title and axis [inch]."""
    half: bool = False
    """Whether it has half the width."""
    note: str = ""
    """Note for the reader at the foot of the page."""


PANELS = (
    Panel("friction", friction.why_no_friction, friction.friction_title, friction.draw_friction, 2.1, False,
          friction.FRICTION_NOTE),
    Panel("loop", friction.why_no_loop, friction.loop_title, friction.draw_loop, 2.3, False, friction.LOOP_NOTE),
    Panel("states", series.why_no_states, series.states_title, series.draw_states, 1.7, False, series.STATES_NOTE),
    Panel("groups", groups.why_no_groups, groups.groups_title, groups.draw_groups, 1.9, False, groups.GROUPS_NOTE),
    Panel("accommodation", accommodation.why_no_accommodation, accommodation.accommodation_title,
          accommodation.draw_accommodation, 1.9, False, accommodation.ACCOMMODATION_NOTE),
    Panel("bed", bed.why_no_bed, bed.bed_title, bed.draw_bed, 1.7, False, bed.BED_NOTE),
    Panel("gap", series.why_no_gap, series.gap_title, series.draw_gap, 1.4),
    Panel("load", series.why_no_load, series.load_title, series.draw_load, 1.4),
    Panel("debris_load", series.why_no_debris_load, series.debris_load_title, series.draw_debris_load, 1.7, False,
          series.DEBRIS_LOAD_NOTE),
    Panel("energy", series.why_no_energy, series.energy_title, series.draw_energy, 2.1, False, series.ENERGY_NOTE),
    Panel("velocity_profile", profiles.why_no_profiles, profiles.velocity_title, profiles.draw_velocity, 2.4, True,
          profiles.PROFILES_NOTE),
    Panel("solid_profile", profiles.why_no_profiles, profiles.solid_title, profiles.draw_solid, 2.4, True),
    Panel("stress_profile", profiles.why_no_profiles, profiles.stress_title, profiles.draw_stress, 2.4, True),
    Panel("states_profile", profiles.why_no_state_profile, profiles.states_profile_title, profiles.draw_states_profile, 2.4,
          True),
    Panel("utilisation", partial(contacts.why_no, "utilisation"), contacts.utilisation_title, contacts.draw_utilisation, 2.0,
          True, contacts.UTILISATION_NOTE),
    Panel("normal_force", partial(contacts.why_no, "normal_force"), contacts.normal_force_title, contacts.draw_normal_force, 2.0,
          True),
)  # fmt: skip
NAMES = tuple(panel.name for panel in PANELS)


def plot(run_path: str | Path, out: str | Path, panels: Sequence[str] | None = None, frame: int = -1) -> Path:
    """Write the page of a run, or the panels named, as .png, .pdf or .svg; return its path.

    `frame` is the frame of the contacts. Raises UsageError for another suffix or an unknown panel, InputError when the run, the
    frame or the data of a panel are missing, OutputError when the file cannot be written (no partial file remains).
    """
    out = checked_path(out)
    check_names(panels)
    with open_run(run_path) as run:
        save(page(run, panels, frame), out)
    return out


def checked_path(path: str | Path) -> Path:
    """Return the path of a picture to write. Raises UsageError for another suffix, OutputError without its folder."""
    path = Path(path)
    check_format(path)
    if not os.path.isdir(path.absolute().parent):
        raise OutputError(f"{path}: cannot be written (the folder {path.parent} does not exist)")
    return path


def check_names(names: Sequence[str] | None) -> None:
    """Raise UsageError for an unknown panel, and for a text in place of a list."""
    if isinstance(names, str):
        raise UsageError(f"panels = {names!r}: must be a list of names")
    for name in names or ():
        if name not in NAMES:
            raise UsageError(f"no panel is called '{name}': there are {', '.join(NAMES)}")


def save(figure: Figure, path: Path) -> None:
    """Write a figure whole or not at all, equal pictures as equal files. Raises OutputError when it cannot be written."""
    kind, content = path.suffix.lower()[1:], io.BytesIO()
    # dates and random names of shapes would make equal pictures differ; letters stay letters in PDF
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with rc_context({"svg.hashsalt": "thirdbody", "pdf.fonttype": 42}), _one_warning_of_letters(path):
        figure.savefig(content, format=kind, dpi=DOTS, metadata=metadata)
    try:
        write_whole(path, content.getvalue())
    except OSError as problem:
        raise OutputError(f"{path}: cannot be written ({problem.strerror})") from problem


@contextmanager
def _one_warning_of_letters(path: Path) -> Iterator[None]:
    """Replace the warnings of matplotlib, one for each letter missing in its font, by a single one."""
    with warnings.catch_warnings(record=True) as caught:
        yield
    lacking = [entry for entry in caught if "missing from font" in str(entry.message)]
    for entry in caught:
        if entry not in lacking:
            warnings.warn_explicit(entry.message, entry.category, entry.filename, entry.lineno)
    if lacking:
        warnings.warn(f"{path}: the font has no sign for some letters, which are drawn as boxes", stacklevel=3)


def page(run: Run, panels: Sequence[str] | None = None, frame: int = -1) -> Figure:
    """Return the page as a matplotlib figure: the panels named, or all that apply to the run. Raises like `plot`."""
    check_names(panels)
    if not run.frames:
        raise InputError(f"{run.path}: nothing to plot: no frame was written yet")
    try:
        data = RunData(run, frame)
    except IndexError as error:
        raise InputError(str(error)) from None
    missing = {panel.name: panel.missing(data) for panel in PANELS}
    there = [name for name in NAMES if not missing[name]]
    for name in panels or ():
        if missing[name]:
            names = ", ".join(there) or "none"
            raise InputError(f"{run.path}: this run has no panel '{name}' ({missing[name]}); it has {names}")
    if not there:
        raise InputError(f"{run.path}: nothing to plot: {'; '.join(dict.fromkeys(missing.values()))}")
    wanted = panels or [name for name in there if name != ("gap" if _gap_is_set(data) and "load" in there else "load")]
    return _compose(data, [next(panel for panel in PANELS if panel.name == name) for name in dict.fromkeys(wanted)])


def _gap_is_set(data: RunData) -> bool:
    """Return whether the scene prescribes the gap: then the load is a result."""
    return data.scene.get("plates", {}).get("upper", {}).get("gap") is not None


def headline(data: RunData) -> list[str]:
    """Return key figures and circumstances, one line each."""
    # broken between figures, not inside them
    lines = [", ".join(text.replace(" ", GLUE) for text in texts) for texts in (_figures(data), _circumstances(data)) if texts]
    if np.isfinite(data.run.friction.value):
        lines.insert(0, f"friction coefficient {data.run.friction}")
    if not data.summary["finished"]:
        why = data.summary.get("stopped") or "no end was written: killed, or still running"
        lines.append(f"Not finished, {data.frames} frame{'s' if data.frames > 1 else ''} kept: {why}")
    elif data.summary.get("stopped"):
        lines.append(f"Stopped after {data.frames} frame{'s' if data.frames > 1 else ''}: {data.summary['stopped']}")
    if data.summary.get("speed_scale"):
        lines.append(f"speed scaled: {data.summary['speed_scale']['text']}")
    if "energy_verdict" in data.summary:
        lines.append(data.summary["energy_verdict"])
    return [line for text in lines for line in textwrap.wrap(text[:1].upper() + text[1:], LETTERS)]


def _figures(data: RunData) -> list[str]:
    result = []
    if data.fractions:
        result.append(f"at the end {series.final_fractions(data)}")
    residual = data.summary.get("energy_residual")
    if residual is not None:
        result.append(f"energy residual {residual:.0e} of the work".replace("e-0", "e-").replace("-", MINUS))
    return result


def _circumstances(data: RunData) -> list[str]:
    header, bodies, times = data.run.header, data.summary.get("bodies", 0), data.run.times
    result = [f"{bodies} bod{'ies' if bodies != 1 else 'y'}"]
    if bodies > 1 and str(header.get("debris_contact", "")).startswith("none"):
        result[0] += " without mutual contact"
    law = header.get("law") or {}
    if law:
        result.append(f"law {law.get('family')} ({law.get('level')})")
    if data.dragged:
        if data.drag.begin > 0.0:
            result.append(f"pressed for {quantity_text(data.drag.begin, 's', 2)}")
        path, elapsed = float(data.drag.distance[-1]), float(times[-1] - data.drag.begin)
        what = (
            f"moved back and forth over {quantity_text(path, 'm')} in all"
            if data.stroke
            else f"dragged {quantity_text(path, 'm')}"
        )
        result.append(f"then {what} in {quantity_text(elapsed, 's', 2)} ({quantity_text(path / elapsed, 'm/s', 2)})")
    elif times[-1] > 0.0:
        result.append(f"{quantity_text(float(times[-1]), 's', 2)} without drag")
    return result


def _compose(data: RunData, panels: list[Panel]) -> Figure:
    title = textwrap.wrap(str(data.run.header.get("title") or data.run.path.parent.name), LETTERS_OF_TITLE)
    head, notes = headline(data), [line for panel in panels for line in textwrap.wrap(panel.note, LETTERS_OF_NOTE)]
    top, foot = TITLE_LINE * len(title) + LINE * len(head) + 0.1, NOTE_LINE * len(notes) + 0.05
    wide, half = [panel for panel in panels if not panel.half], [panel for panel in panels if panel.half]
    parts = [sum(panel.height for panel in wide), sum(panel.height for panel in half[::2])]
    height = sum(parts) + top + foot + 2.0 * EDGE
    figure = _new_figure((WIDTH, height), (0.0, (foot + EDGE) / height, 1.0, sum(parts) / height))
    filled = [(members, part) for members, part in zip((wide, half), parts, strict=True) if members]
    frames = figure.subfigures(len(filled), 1, height_ratios=[part for _, part in filled], squeeze=False)[:, 0]
    for subfigure, (members, _) in zip(frames, filled, strict=True):
        _fill(subfigure, data, members)
    y = _write(figure, EDGE, title, 14.0, TITLE_LINE, INK, "bold")
    _write(figure, y, head, 9.0, LINE, INK)
    _write(figure, height - EDGE - foot + 0.05, notes, 7.0, NOTE_LINE, SOFT)
    return figure


def _fill(subfigure: SubFigure, data: RunData, panels: list[Panel]) -> None:
    """Draw wide panels below each other, or half ones in pairs."""
    columns = 2 if panels[0].half and len(panels) > 1 else 1
    rows = -(-len(panels) // columns)
    heights = [panel.height for panel in panels[::columns]]
    grid = subfigure.add_gridspec(rows, columns, height_ratios=heights)
    axes = [subfigure.add_subplot(grid[k // columns, k % columns]) for k in range(len(panels))]
    for one, panel in zip(axes, panels, strict=True):
        _draw(one, data, panel)
    for one, below in zip(axes[:-1], axes[1:], strict=True):
        if not panels[0].half and one.get_xlabel() == below.get_xlabel():
            one.set_xlabel("")  # only the lowest of the panels over the same axis has the label


def _new_figure(size: tuple[float, float], free: tuple[float, float, float, float]) -> Figure:
    """Return a figure whose axes stay in its `free` part (left, bottom, width, height as fractions); `size` [inch]."""

    class Page(Figure):
        """Figure that notebooks display directly."""

        def _repr_png_(self) -> bytes:
            content = io.BytesIO()
            self.savefig(content, format="png", dpi=100)
            return content.getvalue()

    class Rounded(ConstrainedLayoutEngine):
        """Layout with the same positions to the last bit every time: the solver's order of sums depends on memory addresses."""

        def execute(self, fig: Any) -> Any:
            grids = super().execute(fig)
            for part in fig.subfigs:
                part.bbox_relative.p0, part.bbox_relative.p1 = np.round(part.bbox_relative.get_points(), DECIMALS)
            for axes in fig.axes:
                bounds = np.round(axes.get_position(original=True).bounds, DECIMALS)
                inside = axes.get_in_layout()
                axes.set_position(bounds, which="original")  # this excludes the axes from the layout
                axes.set_in_layout(inside)
            return grids

    layout = Rounded(w_pad=0.15, h_pad=0.05, hspace=0.0, wspace=0.02, rect=free)
    return Page(figsize=size, layout=layout)


def _write(figure: Figure, y: float, lines: list[str], size: float, step: float, color: str, weight: str = "normal") -> float:
    """Write lines of text, without mathematics, the first `y` inch below the top; return the position of the next one."""
    width, height = figure.get_size_inches()
    for text in lines:
        figure.text(MARGIN / width, 1.0 - y / height, text, va="top", ha="left", fontsize=size, color=color, fontweight=weight,
                    parse_math=False).set_in_layout(False)  # fmt: skip
        y += step
    return y


def _draw(axes: Axes, data: RunData, panel: Panel) -> None:
    """Draw the panel with the elements that all panels share."""
    axes.set_label(panel.name)
    axes.tick_params(labelsize=8.0)
    panel.draw(axes, data)
    axes.xaxis.label.set_fontsize(8.5)
    axes.yaxis.label.set_fontsize(8.5)
    axes.spines[["top", "right"]].set_visible(False)
    if not panel.half:
        axes.margins(x=0.02 if panel.name == "loop" else 0.0)
        if panel.name not in ("loop", "states", "groups"):
            x = data.axis[0]
            axes.set_xlim(0.0, x[-1] / unit_for(x, "")[0])
    if panel.name not in ("states", "groups"):
        axes.grid(axis="y", alpha=0.25, linewidth=0.6)
        axes.set_axisbelow(True)
    pad = 5.0 + _draw_legend(axes, panel)
    axes.set_title(panel.title(data), loc="left", fontsize=9.5, fontweight="bold", color=INK, pad=pad)


def _draw_legend(axes: Axes, panel: Panel) -> float:
    """Draw the legend to the right of a wide panel, above a half one; return its height above the panel [points]."""
    handles, labels = axes.get_legend_handles_labels()
    if len(handles) < 2 and panel.name != "states":
        return 0.0
    style: dict[str, Any] = {"fontsize": 7.5, "frameon": False}
    if panel.half:
        style |= {"handlelength": 0.9, "handletextpad": 0.4, "columnspacing": 1.0, "borderaxespad": 0.1}
        axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, **style)
        return 11.0 * -(-len(handles) // 3)
    stacked = panel.name == "states"  # in the order of stacking
    handles, labels = (handles[::-1], labels[::-1]) if stacked else (handles, labels)
    axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, **style)
    return 0.0
