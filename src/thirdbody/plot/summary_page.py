"""Summary page of a run: panels over the drag, of the contacts at a frame, and a headline in words."""

import io
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from thirdbody.errors import InputError, UsageError
from thirdbody.palette import INK, SOFT_INK
from thirdbody.plot import NAMES, bed_panels, drag_panels
from thirdbody.plot.run_data import Panel, RunData
from thirdbody.trajectory.run_file import RunFile
from thirdbody.units import GLUE, MINUS, quantity_text

WIDTH = 8.27  # width of the page [inch]: A4
TITLE_LINE, LINE, NOTE_LINE = 0.27, 0.17, 0.125  # heights of lines of text: title, headline, notes [inch]
LETTERS_OF_TITLE, LETTERS, LETTERS_OF_NOTE = 62, 116, 145  # largest number of letters in such a line, by the width of the page
DECIMALS = 8  # decimals of the positions of axes, as fractions of the page: far below a pixel
EDGE, MARGIN = 0.2, 0.3  # free space above and below, and to the left [inch]

# Panels that the page leaves out, unless they are named, where it has another one that shows nearly the same: the other one.
SHOWN_BY = {
    "groups": "bed", "accommodation": "velocity_profile", "gap": "solid_profile", "states_profile": "bed",
    "normal_force": "stress_profile",
}  # fmt: skip

PANELS = {part.name: part for module in (drag_panels, bed_panels) for part in vars(module).values() if isinstance(part, Panel)}


def page(run: RunFile, panels: Sequence[str] | None = None, frame: int = -1) -> Figure:
    """Return the page as a matplotlib figure: the panels named, or all that apply to the run.

    A panel is one of `NAMES`, or a series of the run. `frame` is the frame of the contacts. Raises UsageError for an unknown
    panel, InputError when the frame or the data of a panel are missing.
    """
    if isinstance(panels, str):
        raise UsageError(f"panels = {panels!r}: must be a list of names")
    if not run.frames:
        raise InputError(f"{run.path}: nothing to plot: no frame was written yet")
    data = RunData(run, frame)
    missing = {name: PANELS[name].missing(data) for name in NAMES}
    there = [name for name in NAMES if not missing[name]]
    series = {
        name: drag_panels.series_panel(name, run.units[name]) for name in panels or () if name in data.series.keys() - PANELS
    }
    for name in panels or ():
        if name not in PANELS | series:
            raise UsageError(f"no panel is called '{name}': there are {', '.join(NAMES)}; nor is a series of the run")
        if missing.get(name):
            names = ", ".join(there) or "none"
            raise InputError(f"{run.path}: this run has no panel '{name}' ({missing[name]}); it has {names}")
    if not there:
        raise InputError(f"{run.path}: nothing to plot: {'; '.join(dict.fromkeys(missing.values()))}")
    # where the scene prescribes the gap, the load is a result
    gap_is_set = data.run.scene_tables.get("plates", {}).get("upper", {}).get("gap") is not None
    unwanted = {"gap" if gap_is_set and "load" in there else "load"}
    left = [] if panels else [name for name in there if SHOWN_BY.get(name) in there and name not in unwanted]
    if len(run.population_names) > 1 and "groups" in left:
        left.remove("groups")
    wanted = panels or [name for name in there if name not in unwanted and name not in left]
    note = f"More panels, by name only: {', '.join(left)}." if left else ""
    return _compose(data, [(PANELS | series)[name] for name in dict.fromkeys(wanted)], note)


def headline(data: RunData) -> list[str]:
    """Return key figures and circumstances, one line each."""
    figures = [f"at the end {data.final_fractions}"] if data.fractions else []
    residual = data.summary.get("energy_residual")
    if residual is not None:
        figures.append(f"energy residual {residual:.0e} of the work".replace("e-0", "e-").replace("-", MINUS))
    # broken between figures, not inside them
    lines = [", ".join(text.replace(" ", GLUE) for text in texts) for texts in (figures, _circumstances(data)) if texts]
    if np.isfinite(data.run.friction.value):
        lines.insert(0, f"friction coefficient {data.run.friction}")
    frames, why = f"{data.frames} frame{'s' if data.frames > 1 else ''}", data.summary.get("stopped")
    if not data.summary["finished"]:
        lines.append(f"Not finished, {frames} kept: {why or 'no end was written: killed, or still running'}")
    elif why:
        lines.append(f"Stopped after {frames}: {why}")
    if data.summary.get("speed_scale"):
        lines.append(f"speed scaled: {data.summary['speed_scale']['text']}")
    if "energy_verdict" in data.summary:
        lines.append(data.summary["energy_verdict"])
    return [line for text in lines for line in textwrap.wrap(text[:1].upper() + text[1:], LETTERS)]


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
        length = quantity_text(path, "m")
        what = f"moved back and forth over {length} in all" if data.stroke else f"dragged {length}"
        result.append(f"then {what} in {quantity_text(elapsed, 's', 2)} ({quantity_text(path / elapsed, 'm/s', 2)})")
    elif times[-1] > 0.0:
        result.append(f"{quantity_text(float(times[-1]), 's', 2)} without drag")
    return result


def _compose(data: RunData, panels: list[Panel], note: str) -> Figure:
    title = textwrap.wrap(str(data.run.header.get("title") or data.run.path.parent.name), LETTERS_OF_TITLE)
    head, texts = headline(data), [*(panel.note for panel in panels), note]
    notes = [line for text in texts for line in textwrap.wrap(text, LETTERS_OF_NOTE)]
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
    _write(figure, height - EDGE - foot + 0.05, notes, 7.0, NOTE_LINE, SOFT_INK)
    return figure


def _fill(subfigure: SubFigure, data: RunData, panels: list[Panel]) -> None:
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
    axes.set_label(panel.name)
    axes.tick_params(labelsize=8.0)
    title = panel.draw(axes, data)
    axes.xaxis.label.set_fontsize(8.5)
    axes.yaxis.label.set_fontsize(8.5)
    axes.spines[["top", "right"]].set_visible(False)
    if not panel.half:
        axes.margins(x=0.02 if panel.name == "loop" else 0.0)
        if panel.name not in ("loop", "states", "groups"):
            axes.set_xlim(0.0, data.x[-1])
    if panel.name not in ("states", "groups"):
        axes.grid(axis="y", alpha=0.25, linewidth=0.6)
        axes.set_axisbelow(True)
    pad = 5.0 + _draw_legend(axes, panel)
    axes.set_title(title, loc="left", fontsize=9.5, fontweight="bold", color=INK, pad=pad)


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
