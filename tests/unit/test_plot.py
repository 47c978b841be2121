"""The page of a run: its panels show what the run recorded; what cannot be drawn is told in one line."""

import html
import os
import re
from functools import partial

import numpy as np
import pytest
from matplotlib.colors import to_hex
from thirdbody.api import open_run
from thirdbody.errors import InputError, MissingLibrary, OutputError, UsageError
from thirdbody.palette import STATE_COLORS
from thirdbody.plot.drag_panels import ledger, loop_area, stretches
from thirdbody.plot.run_data import RunData
from thirdbody.plot.summary_page import NAMES, page
from thirdbody.render import render as render_module
from thirdbody.trajectory.friction import mean_and_error, running_mean
from thirdbody.trajectory.names import Frame
from thirdbody.trajectory.writer import TrajectoryWriter
from thirdbody.units import percent, quantity_text, with_error

STATES = list(STATE_COLORS)
SCENE = """scene = 1\n[[pairs]]\nbetween = ["tin", "steel"]\nfriction = 0.3\n[[debris]]\nmaterial = "tin"
[[pairs]]\nbetween = ["steel", "zinc"]\nfriction = 0.1\n[[debris]]\nmaterial = "zinc"
[[pairs]]\nbetween = ["tin", "zinc"]\nfriction = 0.9
[plates.lower]\nmaterial = "steel"\n[plates.upper]\nmaterial = "steel"\n"""
BODIES, LOAD = 8, 2e-4  # N
STATIC = {"spheres": {"radius": np.ones(BODIES), "clump": np.arange(BODIES)}, "clumps": {}}
LINES = ("kinetic", "elastic_normal", "elastic_tangential", "damping", "friction", "plate_work", "body_effects", "numerical",
         "residual")  # fmt: skip


def straight(frames=41, settled=1):
    return 0.1e-6 * np.maximum(np.arange(frames) - settled, 0.0)


def stroke(cycles=2.25, per_cycle=40):
    """Displacement (F,), m, back and forth between 0 and 80 nm; linear, with frames at the turns."""
    phase = np.arange(int(cycles * per_cycle) + 1) / per_cycle
    return 80e-9 * (1.0 - np.abs(1.0 - 2.0 * (phase % 1.0)))


def series_of(u, mu, number):
    shares = np.bincount(codes(number), minlength=4) / BODIES
    normal = 0.0 if np.isnan(mu[number]) else LOAD
    series = {"time": 1e-6 * number, "distance": float(np.abs(np.diff(u[: number + 1])).sum()), "gap": 8e-6 - 1e-9 * number}
    series |= {"upper_force": np.array([-normal * np.nan_to_num(mu[number]), 0.0, normal]), "friction_coefficient": mu[number]}
    series |= {f"fraction_{name}": shares[k] for k, name in enumerate(STATES)}
    return series | {f"energy_{name}": 1e-9 * (k + 1) * number for k, name in enumerate(LINES)}


def codes(number):
    return np.clip(1 + (number - np.arange(BODIES)) // 8, 1, 3).astype(np.uint8)


def write(folder, u=None, mu=None, contacts=12, labels=True, series=True, plates=True, **header):
    """A run of made-up arrays; `contacts` at every frame but, with a negative number, none at the last."""
    u = straight() if u is None else u
    mu = np.where(np.arange(len(u)) > 0, 0.2 + 0.01 * np.sin(np.arange(len(u))), np.nan) if mu is None else mu
    folder.mkdir()
    head = {"scene_text": SCENE, "title": "eight bodies", "state_names": STATES, "reason_names": ["none"],
            "units": {"distance": "m"}, "law": {"family": "three_spot", "level": "mindlin"}} | header  # fmt: skip
    rng = np.random.default_rng(2)
    with TrajectoryWriter(folder / "run.vtkhdf", head, STATIC) as writer:
        for number in range(len(u)):
            clumps = {"points": np.zeros((BODIES, 3))}
            if labels:
                clumps |= {"state": codes(number), "state_reason": np.zeros(BODIES, np.uint8)}
            count = 0 if contacts < 0 and number == len(u) - 1 else abs(contacts)
            touching = {"points": np.zeros((count, 3)), "body": np.arange(count) % BODIES, "partner": np.full(count, -1)}
            touching |= {"utilisation": np.linspace(0.0, 1.0, count), "normal_force": 1e-5 * rng.random(count)}
            corners = np.zeros((8, 3))
            corners[4:, 0] = u[number]
            made = series_of(u, mu, number) if series else {"time": 1e-6 * number}
            made = {name: value for name, value in made.items() if labels or not name.startswith("fraction_")}
            spheres = {"points": np.zeros((BODIES, 3))}
            writer.append(Frame(1e-6 * number, spheres, clumps, touching, {"points": corners} if plates else None, made))
        writer.finish({"finished": True, "stopped": None, "energy_residual": 2e-5})
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write(tmp_path_factory.mktemp("plot") / "run")


@pytest.fixture(scope="module")
def run(written):
    with open_run(written) as run:
        yield run


@pytest.fixture(scope="module")
def drawn(run):
    figure = page(run)
    return panels(figure), " ".join(text.get_text() for text in figure.texts).replace("\N{NO-BREAK SPACE}", " ")


@pytest.fixture
def folder(tmp_path, written):
    (tmp_path / "run").symlink_to(written, target_is_directory=True)
    return tmp_path / "run"


def panels(figure):
    return {axes.get_label(): axes for axes in figure.axes}


def title(axes):
    return axes.get_title(loc="left").replace("\N{NO-BREAK SPACE}", " ")


def line(axes, label):
    (found,) = (entry for entry in axes.get_lines() if str(entry.get_label()).startswith(label))
    return found


@pytest.mark.parametrize("phi", [0.0, 0.8, 0.95])
def test_the_error_of_a_mean_counts_autocorrelation(phi):
    n = 4000
    # AR(1), x_k = phi x_(k-1) + noise: variance 1/(1 - phi^2), autocorrelation phi^k, thus 2 tau = (1 + phi)/(1 - phi)
    exact = np.sqrt((1.0 + phi) / (1.0 - phi) / (1.0 - phi * phi) / n)
    found = []
    for seed in range(12):
        x = np.random.default_rng(seed).normal(size=n)
        x[0] /= np.sqrt(1.0 - phi * phi)
        for k in range(1, n):
            x[k] += phi * x[k - 1]
        found.append(mean_and_error(x))
    # the estimate of tau scatters by sqrt(2 (2 W + 1)/n) (Madras and Sokal) with W = 5 tau, its root by half of that, and the
    # mean of twelve by sqrt(12) less
    scatter = 0.5 * np.sqrt(2.0 * (5.0 * (1.0 + phi) / (1.0 - phi) + 1.0) / n / 12.0)
    assert np.mean([error for _, error in found]) == pytest.approx(exact, rel=4.0 * scatter + 0.02)
    assert np.sqrt(np.mean([mean**2 for mean, _ in found])) < 2.0 * exact  # chi-square of 12: beyond 4 in 1e-5 of the cases


def test_no_error_is_reported_where_none_is_known():
    assert mean_and_error(np.full(50, 0.3)) == (pytest.approx(0.3, rel=1e-14), 0.0)
    drift = np.linspace(0.2, 0.3, 60)
    assert mean_and_error(drift)[0] == pytest.approx(0.25, rel=1e-12) and np.isnan(mean_and_error(drift)[1])
    assert np.isnan(mean_and_error(np.array([0.1, 0.2, 0.15]))[1])
    assert np.isnan(mean_and_error(np.full(9, np.nan))).all()
    assert mean_and_error(np.tile([0.1, 0.3], 50))[1] == pytest.approx(
        0.1 / np.sqrt(100), rel=0.05
    )  # no credit; bias factor of 3 %
    # a running mean leaves gaps out
    values = np.array([1.0, np.nan, 3.0, np.nan, np.nan, np.nan, 8.0])
    np.testing.assert_array_equal(running_mean(values, 3), [1.0, 2.0, 3.0, 3.0, np.nan, 8.0, 8.0])
    np.testing.assert_allclose(running_mean(np.arange(5.0), 2), [0.5, 1.5, 2.5, 3.5, 4.0], rtol=1e-15)


def test_numbers_for_people():
    words = [quantity_text(value, unit) for value, unit in ((4.19e-8, "J"), (6e-7, "m"), (-3e-30, "J"), (0.0, "J"))]
    shown = [text.replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-") for text in words]
    assert shown == ["41.9 nJ", "600 nm", "-3.00e-30 J", "0 J"]
    assert quantity_text(9.999e-7, "m").startswith("1\N{NO-BREAK SPACE}\N{MICRO SIGN}m")
    assert quantity_text(np.nan, "m") == "unknown"
    assert with_error(0.24738, 0.0021) == "0.2474 \N{PLUS-MINUS SIGN} 0.0021" and with_error(0.24738, np.nan) == "0.247"
    assert [percent(share)[:-2] for share in (0.0, 0.004, 0.41, 0.996, 1.0)] == ["0", "0.4", "41", "99.6", "100"]


def test_friction_and_gap_are_the_series_from_the_start_of_the_drag(run, drawn):
    axes, _ = drawn
    um = run.series["distance"][1:] * 1e6
    drawn = line(axes["friction"], "each interval")
    np.testing.assert_allclose(drawn.get_xdata(), um, rtol=1e-12)
    np.testing.assert_array_equal(drawn.get_ydata()[1:], run.series["friction_coefficient"][2:])
    assert np.isnan(drawn.get_ydata()[0])  # the interval before was the pressing
    mean = run.series["friction_coefficient"][22:].mean()  # from 2 um on, of 3.9 um
    np.testing.assert_allclose(line(axes["friction"], "mean").get_ydata(), mean, rtol=1e-12)
    assert mean == pytest.approx(run.summary()["friction_coefficient"], rel=1e-12)
    assert axes["friction"].get_title(loc="left").startswith(f"Friction coefficient: {mean:.3f}"[:-1])
    # the coefficients of the pairs that meet the plates, in either order
    level = {tuple(entry.get_ydata()) for entry in axes["friction"].get_lines() if entry.get_linestyle() == ":"}
    assert level == {(0.1, 0.1), (0.3, 0.3)} and line(axes["friction"], "running mean\n(over 400")  # nm: four of forty intervals
    (band,) = (entry for entry in axes["friction"].collections if entry.get_label() == "its error")
    ends = band.get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose((ends.min(), ends.max()), mean + run.friction.error * np.array([-1.0, 1.0]), rtol=1e-12)
    np.testing.assert_allclose(
        axes["gap"].get_lines()[0].get_ydata(), -np.arange(40.0), atol=1e-6
    )  # nm; 8 um minus 1 nm a frame, doubles of 1e-21 m
    assert axes["gap"].get_ylabel() == "change of gap (nm)" and title(axes["gap"]).endswith("7.96 µm at the end, closed by 39 nm")


def test_no_mean_is_drawn_over_a_drifting_curve(tmp_path):
    u = straight(81)
    mu = 0.2 + 0.1 * np.arange(81) / 80.0
    mu[0] = np.nan
    with open_run(write(tmp_path / "run", u=u, mu=mu)) as run:
        axes = panels(page(run, ["friction"]))["friction"]
        counted = run.drag.averaged
    assert not [entry for entry in axes.get_lines() if str(entry.get_label()).startswith("mean")]
    trend = line(axes, "trend (second half):\nnot stationary")
    assert trend.get_ydata()[1] > trend.get_ydata()[0] + 0.04  # of 0.1 over the whole drag
    assert trend.get_xdata()[0] >= 1e6 * u[np.flatnonzero(counted)[0] - 1] - 1e-9
    assert "still rising by" in axes.get_title(loc="left")


def test_states_are_stacked_in_their_colours_and_energy_lines_are_the_ledger(run, drawn, tmp_path):
    axes, below = drawn[0]["states"], np.zeros(40)
    assert [collection.get_label() for collection in axes.collections] == ["sticking", "sliding", "rolling"]  # none was free
    for collection in axes.collections:
        below = below + run.series[f"fraction_{collection.get_label()}"][1:]
        assert np.isin(np.round(below, 9), np.round(np.unique(collection.get_paths()[0].vertices[:, 1]), 9)).all()
        assert to_hex(collection.get_facecolor()[0]).upper() == STATE_COLORS[collection.get_label()]
    np.testing.assert_allclose(below, 1.0, rtol=1e-12)
    assert re.search(r"8 bodies: at the end all rolling", axes.get_title(loc="left"))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["rolling", "sliding", "sticking"]  # from above
    axes, lines = drawn[0]["energy"], ledger(RunData(run))
    assert axes.get_ylabel() == "energy (nJ)" and len(axes.get_lines()) == 8
    assert len({(entry.get_color(), entry.get_linestyle()) for entry in axes.get_lines()}) == 8
    for label, values in lines.items():
        np.testing.assert_allclose(line(axes, label).get_ydata(), values * 1e9, rtol=1e-12)
    parts = run.series["energy_elastic_normal"] + run.series["energy_elastic_tangential"]
    np.testing.assert_allclose(lines["elastic, stored"], parts[1:], rtol=1e-14)
    assert "240" in line(axes, "work of the plates").get_label()  # 6 nJ a frame, 40 frames
    # the title counts the sliding alone: frames 0 to 10 press, 6 nJ of work a frame, 5 of it lost in friction
    with open_run(write(tmp_path / "run", u=straight(41, 10))) as pressed:
        words = title(panels(page(pressed, ["energy"]))["energy"])
    assert words == "Energy: 180 nJ of work while sliding, 83 % of it lost in friction; 60 nJ of work while pressing"


def test_histograms_count_every_contact_of_the_frame_by_state(run):
    for frame in (20, -1):
        axes = panels(page(run, frame=frame))
        contacts = run.contacts(frame)
        states = run.bodies(frame)["state"][contacts["body"]]
        for name, factor in (("utilisation", 1.0), ("normal_force", 1e6)):
            values = contacts[name] * factor
            for code in np.unique(states):
                own = [p for p in axes[name].patches if to_hex(p.get_facecolor()).upper() == STATE_COLORS[STATES[code]]]
                # 1/11, 2/11 and so on and random numbers keep clear of the edges at k/25 of the largest, but for the largest
                place = np.minimum((25.0 * values[states == code] / values.max()).astype(int), 24)
                assert [p.get_height() for p in own] == np.bincount(place, minlength=25).tolist()
        when = "frame 20" if frame == 20 else "at the end"
        assert title(axes["utilisation"]) == f"Contacts, {when}: 8 % slip"  # one of twelve at the limit


def test_unloaded_intervals_are_shaded_not_counted(tmp_path, monkeypatch):
    parts = {"rolling": 0.3, "upper_slip": 0.1, "lower_slip": 0.2, "shear": -0.1}  # m/s
    more = {"load_share_debris": 0.25} | {f"accommodation_{name}": value for name, value in parts.items()}

    def with_more(u, mu, number, made=series_of):
        settling = 90.0 if number < 2 else 1.0  # of which nothing is drawn
        return made(u, mu, number) | {"active": 0.5} | {name: value * settling for name, value in more.items()}

    monkeypatch.setattr(f"{__name__}.series_of", with_more)
    mu = np.full(41, 0.2)
    mu[0] = np.nan
    mu[25:31] = np.nan
    with open_run(write(tmp_path / "run", mu=mu, scene_text=SCENE + 'gap = "8 um"\n')) as run:
        axes = panels(page(run))
        assert "gap" not in axes and "load" in axes  # the load is drawn where the gap is prescribed
        np.testing.assert_allclose(np.unique(axes["load"].get_lines()[0].get_ydata()[1:]), (0.0, 1e6 * LOAD), rtol=1e-12)
        assert title(axes["load"]) == "Load: 200 µN at the end, at most 200 µN"
        shares = {entry.get_label(): set(entry.get_ydata()[1:]) for entry in axes["debris_load"].get_lines()}
        assert shares == {"load on debris": {25.0}, "active bodies": {50.0}}
        assert title(axes["debris_load"]) == "Debris carries 25 % of the load at the end, on 50 % of the bodies"
        parts = {entry.get_label(): entry.get_paths()[0].vertices[:, 1] for entry in axes["accommodation"].collections}
        tops = [parts[name].max() for name in ("slip at the upper plate", "slip at the lower plate", "rolling")]
        tops += [line(axes["accommodation"], "the plate").get_ydata().max(), min(map(np.min, parts.values()))]
        assert tops == pytest.approx([100.0, 300.0, 600.0, 500.0, -100.0])  # shear goes downwards
        assert title(axes["accommodation"]) == "Velocity accommodation: 60 % slip, 60 % rolling, \N{MINUS SIGN}20 % shear"
        axes = axes["friction"]
        assert line(axes, "mean").get_ydata()[0] == pytest.approx(0.2, rel=1e-14)
        (shade,) = (patch for patch in axes.patches if patch.get_label() == "unloaded")
        # frames 25 to 30 end the intervals from 2.3 to 2.9 um
        np.testing.assert_allclose((shade.get_x(), shade.get_x() + shade.get_width()), (2.3, 2.9), rtol=1e-9)
    assert stretches(np.array([True, False, True, True])) == [(0, 0), (2, 3)]


def test_a_friction_loop_has_the_area_of_its_parallelogram(tmp_path):
    # frames stand at the turns; within two intervals behind each (8 nm) friction turns over, linearly
    u = stroke()
    side = np.sign(np.diff(u, prepend=u[0]))
    mu = 0.2 * np.where(np.roll(side, 1) * side < 0, 0.0, side)
    mu[0] = np.nan
    with open_run(write(tmp_path / "run", u=u, mu=mu, debris_contact="none (declared)")) as run:
        sheet = RunData(run)
        assert run.drag.reversals == [20, 40, 60, 80] and sheet.drag.cycles[-1] == slice(40, 81)
        area, size, work = loop_area(sheet), run.friction.value, run.friction.energy_per_cycle
        # 160 nm a cycle, two intervals of 4 nm of it without friction
        assert area == pytest.approx(0.2 * (160e-9 - 8e-9), rel=1e-9)
        assert work == pytest.approx(LOAD * area, rel=1e-9) and size == pytest.approx(area / 160e-9, rel=1e-9)
        axes = panels(page(run))
        assert "friction" not in axes and list(axes)[0] == "loop"
        x, y = line(axes["loop"], "last whole cycle").get_data()
        # at the middle of each interval, nm, at both turns with the coefficient before, and closed
        np.testing.assert_allclose(x[:21], [*(2.0 + 4.0 * np.arange(20.0)), 80.0], rtol=1e-9)
        assert y[:21].tolist() == [*mu[41:61], mu[60]] and y[21:].tolist() == [*mu[61:81], mu[80], mu[41]]
        assert (x[-1], y[-1]) == (x[0], y[0]) and (x.min(), x.max()) == pytest.approx((0.0, 80.0), abs=1e-9)
        words = " ".join(text.get_text() for text in page(run, ["loop"]).texts).replace("\N{NO-BREAK SPACE}", " ")
        assert "8 bodies without mutual contact" in words and "moved back and forth over 360 nm in all in 90 µs (4 mm/s)" in words
        assert "area 30.4" in axes["loop"].get_title(loc="left")
        assert axes["states"].get_xlabel() == "" and axes["energy"].get_xlabel().startswith("time of the drag")


def test_the_panels_requested_and_no_other_under_the_key_figures(run, drawn):
    assert list(drawn[0]) == ["friction", "states", "gap", "energy", "utilisation", "normal_force"]
    assert list(panels(run.plot(panels=["states", "load", "states"]))) == ["states", "load"]
    assert list(panels(page(run, ["normal_force", "friction"]))) == ["friction", "normal_force"]
    vector, path = (axes for axes in run.plot(panels=["upper_force", "distance"]).axes if axes.lines)
    assert [line.get_label() for line in vector.lines] == ["x", "y", "z"]
    assert title(path) == "Distance" and path.get_ylabel() == "(\N{MICRO SIGN}m)"
    with pytest.raises(InputError, match=r"no panel 'loop' \(the plate never turns back\); it has friction, states, gap"):
        page(run, ["states", "loop"])
    with pytest.raises(UsageError, match="no panel is called 'frction': there are " + ", ".join(NAMES)):
        page(run, ["frction"])
    with pytest.raises(InputError, match="no frame 77"):
        page(run, frame=77)
    texts = drawn[1]
    assert texts.startswith("eight bodies Friction coefficient 0.2") and "At the end all rolling" in texts
    assert "energy residual 2e\N{MINUS SIGN}5 of the work" in texts and "law three_spot (mindlin)" in texts
    assert "pressed for 1 µs, then dragged 3.9 µm in 39 µs (100 mm/s)" in texts


def test_panels_without_data_are_left_out(tmp_path):
    for name, words, left in (
        ("bare", {"u": straight(9), "labels": False, "series": False, "contacts": 0, "plates": False}, []),
        ("unlabelled", {"u": straight(9), "labels": False}, ["friction", "gap", "energy", "utilisation", "normal_force"]),
        ("lifted", {"u": straight(9), "contacts": -12}, ["friction", "states", "gap", "energy"]),
        ("still", {"u": np.zeros(9)}, ["states", "gap", "energy", "utilisation", "normal_force"]),
        ("first", {"u": np.zeros(1)}, ["states", "utilisation", "normal_force"]),
        ("unloaded", {"u": straight(9), "mu": np.full(9, np.nan), "contacts": 0}, ["states", "gap", "energy"]),
    ):  # fmt: skip
        with open_run(write(tmp_path / name, **words)) as run:
            if left:
                assert list(panels(page(run))) == left, name
            else:
                with pytest.raises(InputError, match="nothing to plot: no drag; .*its bodies were not labelled"):
                    page(run)


@pytest.mark.filterwarnings("error")
def test_the_suffix_is_the_format_and_equal_pages_are_equal_files(run, tmp_path):
    for name, start in (("a.PNG", b"\x89PNG"), ("b.pdf", b"%PDF"), ("c.svg", b"<?xml")):
        run.plot(tmp_path / name, ["gap"])
        data = (tmp_path / name).read_bytes()
        assert data.startswith(start) and len(data) > 5_000, name
        if name != "a.PNG":
            assert b"<image" not in data and b"/Subtype /Image" not in data  # lines stay lines
        if name != "b.pdf":
            run.plot(tmp_path / f"again_{name}", ["gap"])
            assert (tmp_path / f"again_{name}").read_bytes() == data, name


def test_the_command_and_python_write_what_they_name(command, run, folder, tmp_path):
    command = partial(command, "plot")
    assert set(NAMES) <= set(command("--help")[1].replace(",", " ").split())
    assert command("run", "-o", "x.svg", "--panel", "states", "--panel", "energy", "--frame", "3") == (0, "x.svg\n", "")
    text = (tmp_path / "x.svg").read_text(encoding="utf-8")
    assert "States of the 8 bodies" in text and "Energy: " in text and "Contacts, " not in text
    assert command("run", "--panel", "gap") == (0, "plot.png\n", "")
    figure = run.plot(tmp_path / "y.svg", ["gap"])
    assert list(panels(figure)) == ["gap"] and (tmp_path / "y.svg").read_bytes().startswith(b"<?xml")
    assert figure._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(UsageError):
        run.plot("x.gif")


def test_what_cannot_be_drawn_is_reported_in_one_line(command, run, folder, tmp_path):
    code, out, err = command("plot", "run", "-o", "x.gif")
    assert code == 2 and "x.gif: a picture ends in .png, .pdf, .svg" in err and len(err.splitlines()) == 1 and not out
    assert os.listdir(tmp_path) == ["run"]
    (tmp_path / "x.png").mkdir()
    with pytest.raises(OutputError, match="x.png: cannot be written"):
        run.plot(tmp_path / "x.png", ["gap"])
    assert sorted(os.listdir(tmp_path)) == ["run", "x.png"]


def test_a_notebook_shows_a_table_and_the_page_or_one_sentence(run, tmp_path, monkeypatch):
    text = run._repr_html_()
    content = html.unescape(re.search(r'srcdoc="([^"]*)"', text)[1])
    assert content.startswith("<!DOCTYPE html>") and content.count("</script>") == 1 and "<b>eight bodies</b>" in text
    assert STATE_COLORS["rolling"] in text and "2.0e-05 of the work" in text

    def refuse(*_, **__):
        raise MissingLibrary("no library to draw <here>")

    monkeypatch.setattr(render_module, "render", refuse)
    text = run._repr_html_()
    assert "No page: no library to draw &lt;here&gt;" in text and "<iframe" not in text and "<table>" in text
    with open_run(write(tmp_path / "marked", u=straight(3), title="<script>")) as marked:
        assert "<script>" not in marked._repr_html_()
