# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip figures` and `stickslip map`: files that can be looked at, with the numbers in them."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from stickslip_ros.cli.figures import FIGURES
from stickslip_ros.cli.main import main
from stickslip_ros.model.extinction import work_integral
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.output.stability_map import MapSubject, map_figure, map_of

pytestmark = pytest.mark.slow


def rows(path: Path) -> list[dict[str, str]]:
    """The numbers of a figure."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All figures, drawn once; the map of two of them with few points, as it takes most of the time."""
    out = tmp_path_factory.mktemp("figures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stickslip_ros.cli.figures._MAP_POINTS", (50, 40))
        assert main(["figures", "--out", str(out)]) == 0
    return out


@pytest.mark.nightly
def test_every_figure_in_three_forms(folder: Path) -> None:
    """Issue 3: Figs 1, 5, 6, 8, 9, 11, 12, 13 and 14 as PNG and SVG with the data as CSV, and nothing else."""
    expected = {f"figure_{number:02d}.{ending}" for number in FIGURES for ending in ("png", "svg", "csv")}
    assert {path.name for path in folder.iterdir()} == expected
    assert FIGURES == (1, 5, 6, 8, 9, 11, 12, 13, 14)
    for path in folder.glob("*.png"):
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert path.stat().st_size > 10_000
    for path in folder.glob("*.svg"):
        assert "</svg>" in path.read_text(encoding="utf-8")


def test_numbers_are_the_equations(folder: Path) -> None:
    """Issue 3: the CSV beside Fig. 9 is Eq. (27); each row names its axes with their units."""
    curve = [row for row in rows(folder / "figure_09.csv") if row["curve"] == "τ* = 1"]
    x, y = (np.array([float(row[key]) for row in curve]) for key in ("x", "y"))
    np.testing.assert_allclose(y, work_integral(10**x, 1.0), atol=1e-7)
    assert all("[" in row["x_label"] and "[" in row["y_label"] for row in curve)


def test_figure_13_shows_the_paper_rows(folder: Path) -> None:
    """Issue 3: the boundary of Fig. 13 at k_v = 0 passes the rows of physics.md, section 3."""
    curve = [row for row in rows(folder / "figure_13.csv") if row["curve"].startswith("$k_v$ = 0 ")]
    x, y = (np.array([float(row[key]) for row in curve]) for key in ("x", "y"))
    order = np.argsort(x)
    for speed, stiffness in ((0.5, 1106.14), (0.85, 871.97), (1.0, 745.58), (2.0, 359.47)):
        assert np.interp(5.8 * speed, x[order], y[order]) == pytest.approx(stiffness, rel=0.01)
    exact = [row for row in rows(folder / "figure_13.csv") if row["curve"] == "exact"]
    assert len(exact) > 50


def test_figure_14_leaves_the_trial_points_out_and_says_so(folder: Path) -> None:
    """Issue 3: two boundaries at k'_v = 4.9, no invented points, and a note."""
    assert {row["curve"] for row in rows(folder / "figure_14.csv")} == {"Eq. (43)", "integrated exactly"}
    assert "17 trial points are not available" in " ".join(
        (folder / "figure_14.svg").read_text(encoding="utf-8").replace("<!--", "").split()
    )


def test_one_figure_alone_is_always_the_same(tmp_path: Path) -> None:
    """Issue 3: a figure asked for by its number, drawn twice, is the same file."""
    for name in ("one", "two"):
        assert main(["figures", "8", "--out", str(tmp_path / name)]) == 0
        assert {path.suffix for path in (tmp_path / name).iterdir()} == {".png", ".svg", ".csv"}
    assert (tmp_path / "one/figure_08.svg").read_bytes() == (tmp_path / "two/figure_08.svg").read_bytes()


def test_map_of_a_joint(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 3: `map` draws both boundaries and the operating point, and prints the files."""
    out = tmp_path / "here.png"
    command = "map --model puma560_joint1 --stiffness 2016 --velocity 0.00493 --damping 20 --points 400 --out"
    assert main([*command.split(), str(out)]) == 0
    printed = capsys.readouterr().out.split()
    assert printed == [str(out.with_suffix(ending)) for ending in (".png", ".svg", ".csv")]
    curves = {row["curve"]: row for row in rows(out.with_suffix(".csv"))}
    assert {"stick-slip ends by Eq. (43)", "stick-slip ends (integrated)", "moves steadily from here on"} < set(curves)
    here = curves["now: 4.93 mrad/s, 2016 N·m/rad"]
    assert (float(here["x"]), float(here["y"])) == (pytest.approx(4.93), 2016.0)
    # The exact verdict on this joint: the exact boundary runs above it, at the same speed.
    exact = [
        row
        for row in rows(out.with_suffix(".csv"))
        if row["curve"] == "stick-slip ends (integrated)" and row["x"] != "nan"
    ]
    near = [float(row["y"]) for row in exact if abs(math.log(float(row["x"]) / 4.93)) < 0.1]
    assert max(near) == pytest.approx(2414.0, rel=0.15)


def test_what_is_on_a_map_is_seen(tmp_path: Path) -> None:
    """Issue 40, item 6: the regions of a map differ in colour (swings was nearly white); over many decades the axes
    have labels (there were none).
    """
    out = tmp_path / "here.png"
    command = "map --model puma560_joint1 --damping 20 --points 200 --out"
    assert main([*command.split(), str(out)]) == 0
    colours, counts = np.unique(imread(out).reshape(-1, 4)[:, :3], axis=0, return_counts=True)
    white, *shades = colours[np.argsort(-counts)][:3]
    for one, other in ((white, shades[0]), (white, shades[1]), (shades[0], shades[1])):
        assert np.abs(one - other).max() > 0.12
    wide = "map --inertia 800 --stribeck 100 --stribeck-velocity 1e-5 --velocity 1 --stiffness 5 --points 100 --out"
    assert main([*wide.split(), str(out)]) == 0
    figure = out.with_suffix(".svg").read_text(encoding="utf-8")
    # The right scale has an empty x axis of its own, which is the first.
    axes = figure.split('<g id="matplotlib.axis_')[2:]
    assert len(axes) == 3
    for axis in axes:
        assert 3 <= len(re.findall(r"<!-- [\d.e+]+ -->", axis)) <= 12


def test_the_star_is_where_the_joint_moves_steadily(puma: Joint) -> None:
    """Issue 36: it lay in the red region, which was that of the present damping."""
    present, speed = Gains(stiffness=630.0), 0.0058
    advised = recommend(puma, present, speed)[Kind.LEAST_CHANGE].gains
    subject = MapSubject(name="joint1", joint=puma, gains=present, velocity=speed, advised=advised)
    panels = map_figure(subject, map_of(subject, 600)).panels
    for panel, gains, inside in zip(panels, (present, advised), ([True, True], [False, False]), strict=True):
        column, row = (
            int(np.argmin(np.abs(np.log(axis / value))))
            for axis, value in ((panel.regions[0].x, 1e3 * speed), (panel.regions[0].y, float(gains.stiffness)))
        )
        assert [bool(region.inside[row, column] > 0) for region in panel.regions] == inside


def test_what_has_no_answer_is_not_drawn_as_steady(puma: Joint) -> None:
    """Points of absurd joints were white, of which the title said that the joint moves steadily there."""
    subject = MapSubject(name="joint1", joint=puma, gains=Gains(stiffness=630.0), velocity=0.0058, advised=None)
    computed = map_of(subject, 100)
    assert "grey" not in map_figure(subject, computed).title
    exact = np.zeros_like(computed.exact_damping)
    exact[0, 0] = math.nan
    found = replace(computed, exact_damping=exact, steady_damping=np.zeros_like(exact))
    figure = map_figure(subject, found)
    assert figure.title.endswith("gives no answer (grey)")
    assert figure.panels[0].regions[-1].inside[0, 0] > 0
    assert found.outcomes(0.0)[0, :2].tolist() == [3, 2]


def test_map_without_an_operating_point(tmp_path: Path) -> None:
    """Issue 3: at standstill there is no point to draw; the map is there all the same and says so."""
    out = tmp_path / "map.png"
    assert main(["map", "--model", "puma560_joint1", "--velocity", "0", "--points", "100", "--out", str(out)]) == 0
    assert not any(row["curve"].startswith("now") for row in rows(out.with_suffix(".csv")))
    assert "no operating point" in out.with_suffix(".svg").read_text(encoding="utf-8")
