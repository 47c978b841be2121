"""Run in a notebook: a table of its key figures, and the page for a browser."""

import tempfile
from html import escape
from pathlib import Path

from thirdbody.errors import ThirdbodyError
from thirdbody.palette import state_colors
from thirdbody.render import render
from thirdbody.trajectory.run_file import RunFile
from thirdbody.units import percent, quantity_text

HEIGHT = 620  # of the page [pixels]


def run_html(run: RunFile) -> str:
    """Return table and page as self-contained HTML; where the page fails one sentence gives the reason."""
    left = 'style="text-align:left"'
    rows = "".join(f"<tr><th {left}>{escape(name)}</th><td {left}>{text}</td></tr>" for name, text in _rows(run))
    title = escape(str(run.header.get("title") or run.path.parent.name))
    page = ""
    if run.frames:
        with tempfile.TemporaryDirectory() as folder:
            try:
                content = escape(render.render(run.path, Path(folder) / "run.html").read_text(encoding="utf-8"))
                page = f'<iframe width="100%" height="{HEIGHT}" style="border:0" srcdoc="{content}"></iframe>'
            except ThirdbodyError as problem:
                page = f"<p>No page: {escape(str(problem))}</p>"
    return f"<div><b>{title}</b><table>{rows}</table>{page}</div>"


def _rows(run: RunFile) -> list[tuple[str, str]]:
    figures = run.summary()
    end = "yes" if figures["finished"] and not figures.get("stopped") else escape(str(figures.get("stopped") or "no"))
    rows = [("run", escape(str(run.path.parent))), ("finished", end), ("frames", str(figures["frames"]))]
    if not figures["frames"]:
        return rows
    rows += [("bodies", str(figures["bodies"])), ("time", quantity_text(figures["duration"], "s"))]
    if figures.get("distance", 0.0) > 0.0:
        rows += [("sliding distance", quantity_text(figures["distance"], "m"))]
        rows += [("friction coefficient", escape(str(run.friction)))]
    if "fractions" in figures:
        colored = zip(figures["fractions"].items(), state_colors(list(figures["fractions"])), strict=True)
        states = [
            f'<span style="color:{color}">&#9632;</span> {escape(name)} {percent(fraction)}'
            for (name, fraction), color in colored if fraction > 0.0
        ]  # fmt: skip
        rows += [("states at the end", ", ".join(states))]
    if figures.get("energy_residual") is not None:
        rows += [("energy residual", f"{figures['energy_residual']:.1e} of the work")]
    return rows + [("warning", escape(text)) for text in figures["warnings"]]
