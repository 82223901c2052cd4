# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Layouts in config/views: every name in them is one that the running nodes publish, or could."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any

import yaml
from conftest import ROOT
from nodes.forked_nodes import NodeProcess
from nodes.support_ros import Probe, probe

from stickslip_ros.output.published import MARGIN_FIELDS

VIEWS = ROOT / "config" / "views"
LEARNT = {"stribeck [N*m]", "coulomb [N*m]"}  # once there is something learnt


def strings(content: Any) -> Iterator[str]:
    """Every text in a nested structure."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from strings(value)
    elif isinstance(content, list):
        for value in content:
            yield from strings(value)


def check_the_foxglove_layout(published: Probe) -> None:
    """Panels are those of the layout; topics, fields and keys are the node's."""
    layout = json.loads((VIEWS / "foxglove.json").read_text(encoding="utf-8"))
    ids = {text for text in strings(layout["layout"]) if "!" in text}
    assert ids == set(layout["configById"])
    topics = {name for name, _ in published.node.get_topic_names_and_types()}
    labels = {3: "damping_ratio", 4: "critical, by Eq. (43)", 14: "critical, exactly", 2: "energy_margin"}
    seen = set()
    for panel in layout["configById"].values():
        for path in panel.get("paths", []):
            topic, _, rest = path["value"].partition(".")
            assert topic in topics
            index = re.fullmatch(r"data\[(\d+)\]", rest)
            if index:
                seen.add(int(index.group(1)))
                assert path["label"] == labels[int(index.group(1))]
            elif topic == "/diagnostics":
                assert re.search(r'\{key=="(.+?)"\}', rest).group(1) in published.diagnostics["joint1"][2]
            else:
                assert re.fullmatch(r"(position|velocity|effort)\[0\]", rest)
        assert panel.get("topicToRender", "/diagnostics") in topics
    assert layout["configById"]["Image!map"]["imageMode"]["imageTopic"] in topics
    fields = ("energy_margin", "damping_ratio", "critical_damping_ratio", "exact_critical_damping_ratio")
    assert [MARGIN_FIELDS[index] for index in sorted(seen)] == list(fields)
    assert layout["globalVariables"]["joint"] in published.diagnostics


def check_the_plotjuggler_layout(published: Probe) -> None:
    """Every curve is a number that PlotJuggler makes of the node's topics, and its topic is subscribed to."""
    root = ET.parse(VIEWS / "plotjuggler.xml").getroot()
    subscribed = set(root.find(".//selected_topics").get("value").split(";"))
    assert subscribed <= {name for name, _ in published.node.get_topic_names_and_types()}
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) > 10
    for curve in curves:
        if curve.startswith("/diagnostics/"):
            _, _, hardware, name, key = curve.split("/", 4)
            assert name == (
                "stickslip_monitor" if hardware == "stickslip_monitor" else f"stickslip_monitor: {hardware}"
            )
            float(published.diagnostics[hardware][2][key])
        else:
            assert re.fullmatch(r"/joint_(states|references)/joint1/(position|velocity)", curve)
        assert any(curve.startswith(f"{topic}/") for topic in subscribed)
    for splitter in root.iter("DockSplitter"):
        assert len(splitter.get("sizes").split(";")) == int(splitter.get("count")) == len(splitter.findall("DockArea"))


def check_that_the_analyzers_take_every_status(published: Probe) -> None:
    """diagnostic_aggregator finds the joints' statuses and the monitor's own, each in one group."""
    content = yaml.safe_load((VIEWS / "diagnostic_analyzers.yaml").read_text(encoding="utf-8"))
    group = content["/**"]["ros__parameters"]["stick_slip"]["analyzers"]
    for name, joint in (("stickslip_monitor: joint1", True), ("stickslip_monitor", False)):
        for robot in ("", "robot1/"):
            assert any(part in robot + name for part in group["joints"]["contains"]) is joint
            assert any(re.fullmatch(part, robot + name) for part in group["monitor"]["regex"]) is not joint
    assert {"stickslip_monitor", "joint1"} <= set(published.diagnostics)


def test_views(ros_domain: int) -> None:
    """Issue 8: Foxglove, PlotJuggler and diagnostic_aggregator find all that their files name."""
    parameters = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "controller": "/simulated_joint"}
    with NodeProcess("simulated_joint", {}), NodeProcess("monitor", parameters), probe() as one:
        one.wait_for_monitor()
        wanted = {"exact critical_damping_ratio [1]", "recommended stiffness [N*m/rad]", *LEARNT}
        one.wait(lambda: wanted <= set(one.diagnostics.get("joint1", (b"", "", {}))[2]), "all that is published")
        check_the_foxglove_layout(one)
        check_the_plotjuggler_layout(one)
        check_that_the_analyzers_take_every_status(one)
