# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The pages, opened in a real browser: no errors, plots drawn, zooming, both colour schemes, phone, print."""

from __future__ import annotations

import base64
import html
import re
from dataclasses import replace
from pathlib import Path

import pytest
from browser import browser
from selenium.webdriver.common.action_chains import ActionChains
from support_bags import sticking

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.report.plots import PLOTS, advised_map_plot, position_dependence_plot, time_dependence_plot
from stickslip_ros.analysis.report.report import write_report
from stickslip_ros.bags.simulated import write_simulation
from stickslip_ros.cli.main import main
from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

_PAINTED = """
return [...document.querySelectorAll('.plot')].map(plot => {
  const canvases = [];
  const visit = node => {
    if (node.tagName === 'CANVAS') canvases.push(node);
    for (const child of [...node.children, ...(node.shadowRoot ? node.shadowRoot.children : [])]) visit(child);
  };
  visit(plot);
  let most = 0;
  for (const canvas of canvases) {
    if (!canvas.width || !canvas.height) continue;
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    const colours = new Set();
    for (let i = 0; i < data.length; i += 4) colours.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
    most = Math.max(most, colours.size);
  }
  return most;
});
"""
_FIRST_FIGURE = "Bokeh.documents[0].roots()[0]"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of an arm of which one joint sticks; with friction learnt."""
    folder = tmp_path_factory.mktemp("report")
    stiff = replace(sticking(0.02), gains=Gains(stiffness=6300.0, damping=150.0))
    write_simulation(
        folder / "arm.mcap", {"shoulder": sticking(0.006), "wrist": stiff}, duration=25.0, rate=250.0, start=1.79e9
    )
    path = folder / "report.html"
    assert main(["analyze", str(folder / "arm.mcap"), "--html", str(path), "--json"]) == 0
    return path


def test_the_page_is_one_file_that_needs_nothing(report: Path) -> None:
    """Issue 6, item 4: one self-contained file without a network, in words too, and small."""
    text = report.read_text(encoding="utf-8")
    assert report.stat().st_size < 3_000_000
    assert not re.search(r"<(script|img|iframe)[^>]*\ssrc=|<link[^>]*href=['\"](?!data:)", text)
    assert "shoulder sticks and slips at 0.00" in text
    assert "Change damping from 0 to" in text
    assert "Friction compensation, with the advised gains" in text
    assert "Steps: position minus reference" in text
    assert "2026-" in text
    for meaning in ("Coulomb friction", "Stribeck velocity", "Friction estimated from"):
        assert meaning in text
    captions = re.findall(r"role='img' aria-label='([^']*)'", text)
    assert len(captions) == len(re.findall("<figcaption>", text)) >= 5
    assert all(len(html.unescape(caption)) > 30 for caption in captions)


def test_the_page_in_a_browser(report: Path) -> None:
    """Issue 6: opened in Chromium: no console errors, every plot drawn, zooming works, light and dark."""
    with browser() as page:
        page.prefer("light")
        page.open(report)
        assert page.run("return document.documentElement.dataset.scheme") == "light"
        page.wait(lambda: min(page.run(_PAINTED)) > 3, "every plot to be painted")
        assert len(page.run(_PAINTED)) >= 5
        before = page.run(f"return [{_FIRST_FIGURE}.x_range.start, {_FIRST_FIGURE}.x_range.end]")
        plot = page.driver.find_element("css selector", ".plot")
        page.driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
        drag = ActionChains(page.driver).move_to_element_with_offset(plot, -100, -40)
        drag.click_and_hold().move_by_offset(150, 90).release().perform()

        def zoomed() -> bool:
            start, end = page.run(f"return [{_FIRST_FIGURE}.x_range.start, {_FIRST_FIGURE}.x_range.end]")
            return bool(before[0] < start < end < before[1] and end - start < 0.5 * (before[1] - before[0]))

        page.wait(zoomed, "the zoom")
        light = page.run("return getComputedStyle(document.body).backgroundColor")
        page.prefer("dark")
        page.wait(lambda: page.run("return document.documentElement.dataset.scheme") == "dark", "the dark scheme")
        assert page.run("return getComputedStyle(document.body).backgroundColor") != light
        assert page.run(f"return {_FIRST_FIGURE}.background_fill_color") == "#0d1117"
        assert page.complaints() == []


@pytest.mark.nightly
def test_the_page_on_a_phone_and_on_paper(report: Path) -> None:
    """Issue 6, item 4: nothing is wider than a phone; on paper colours are light and the page has all plots."""
    with browser() as page:
        metrics = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
        page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
        page.prefer("dark")
        page.open(report)
        page.wait(lambda: min(page.run(_PAINTED)) > 3, "every plot to be painted")
        assert page.run("return document.documentElement.scrollWidth") <= 390
        widths = page.run(
            "return [...document.querySelectorAll('.plot')].map(one => one.getBoundingClientRect().width)"
        )
        assert min(widths) > 250
        assert page.run(f"return {_FIRST_FIGURE}.toolbar.active_drag") is None
        page.run("window.dispatchEvent(new Event('beforeprint'))")
        assert page.run(f"return {_FIRST_FIGURE}.background_fill_color") == "#ffffff"
        page.run("window.dispatchEvent(new Event('afterprint'))")
        assert page.run(f"return {_FIRST_FIGURE}.background_fill_color") == "#0d1117"
        paper = base64.b64decode(page.driver.execute_cdp_cmd("Page.printToPDF", {})["data"])
        assert paper.startswith(b"%PDF")
        assert len(paper) > 100_000
        assert page.complaints() == []


def test_names_are_text_and_nothing_else(tmp_path: Path) -> None:
    """Issue 6, item 4: names come from a file somebody sent; in the page they are text, never markup or script."""
    name = "<script>document.title='owned'</script>'\"{plot}"
    write_simulation(tmp_path / "bag.mcap", {name: sticking()}, duration=8.0, rate=200.0)
    options = AnalysisOptions(parameters=Parameters({"learn": False}), with_traces=True)
    write_report(tmp_path / "report.html", analyze(tmp_path / "bag.mcap", options))
    with browser() as page:
        page.open(tmp_path / "report.html")
        assert page.run("return document.title") == "Stick-slip in bag.mcap"
        assert name in page.run("return document.querySelector('h2').textContent")
        assert page.complaints() == []


@pytest.mark.nightly
def test_an_hour_fits_into_the_page(tmp_path: Path) -> None:
    """Issue 6, item 4: under 5 MB for an hour of data, whatever its rate."""
    speeds = (0.004, 0.006, 0.008, 0.05, 0.06, 0.07, 0.08)
    joints = {f"joint{number + 1}": sticking(speed) for number, speed in enumerate(speeds)}
    write_simulation(tmp_path / "hour.mcap", joints, duration=3600.0, rate=20.0)
    options = AnalysisOptions(parameters=Parameters({"learn": False, "model.*": "puma560_joint1"}), with_traces=True)
    write_report(tmp_path / "report.html", analyze(tmp_path / "hour.mcap", options))
    assert (tmp_path / "report.html").stat().st_size < 5_000_000


def test_slow_recordings_have_every_plot(tmp_path: Path) -> None:
    """Issue 6, item 4: at 20 Hz, where minutes lie in one chunk, the usual cycle is there all the same."""
    write_simulation(tmp_path / "slow.mcap", {"a": sticking(0.004)}, duration=200.0, rate=20.0)
    options = AnalysisOptions(parameters=Parameters({"learn": False, "model.*": "puma560_joint1"}), with_traces=True)
    joint = analyze(tmp_path / "slow.mcap", options).joints["a"]
    assert joint.traces is not None
    close_up = joint.traces.close_up()
    assert close_up is not None
    assert close_up.samples.time[0] < close_up.cycle.breakaway < close_up.cycle.arrest < close_up.samples.time[-1]
    advised = joint.assessment.recommended
    assert advised is not None
    shown = {make: make(joint) is not None for make in PLOTS}
    # Nothing is learnt here, and so nothing of what dry friction depends on.
    learnt = {position_dependence_plot: False, time_dependence_plot: False}
    assert shown == dict.fromkeys(PLOTS, True) | {advised_map_plot: advised.found} | learnt


def test_a_page_of_nothing_much(tmp_path: Path) -> None:
    """Issue 6, item 4: a recording in which nothing moved has a page too."""
    write_simulation(tmp_path / "bag.mcap", {"a": sticking(0.0)}, duration=3.0, rate=100.0)
    assert main(["analyze", str(tmp_path / "bag.mcap"), "--html", str(tmp_path / "report.html"), "--json"]) == 0
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "None of 1 joint sticks and slips" in text


def test_the_table_and_legends_have_room(tmp_path: Path) -> None:
    """Issue 40, item 6: at 1400 px the table of a joint with a long name is not cut, items of a legend do not touch;
    one joint "sticks and slips".
    """
    bag, page = tmp_path / "bag.mcap", tmp_path / "report.html"
    write_simulation(bag, {"left_arm_shoulder_pan_joint": sticking(0.007)}, duration=15.0, rate=200.0)
    assert main(["analyze", str(bag), "--html", str(page), "--json"]) == 0
    with browser(1400) as view:
        view.open(page)
        assert view.run("const one = document.querySelector('.scroll'); return one.scrollWidth - one.clientWidth") == 0
        assert "1 of 1 joint sticks and slips" in view.run("return document.body.textContent")
        legends = "[...Bokeh.documents[0]._all_models.values()].filter((one) => one.type === 'Legend')"
        assert min(view.run(f"return {legends}.map((one) => one.spacing)")) >= 10
