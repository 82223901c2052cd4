# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Controllers come late, go, return, change their name or never answer; gains come in other units."""

from __future__ import annotations

import itertools
import math
import time

import pytest
import yaml
from conftest import LIMIT, ROOT
from nodes.forked_nodes import NodeProcess
from rcl_interfaces.srv import ListParameters
from support_ros import Probe, probe
from test_apply_over_dds import FAULTY

PUMA = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false"}
SMOOTH = {"gains.joint1.p": 9000.0, "gains.joint1.d": 200.0}


def controller(one: Probe) -> str:
    """What the monitor says of its controllers."""
    return one.diagnostics["stickslip_monitor"][2]["controller"]


def gains(one: Probe, joint: str = "joint1") -> tuple[float, float]:
    """What the monitor computes with."""
    row = one.margins.get(joint, {})
    return row.get("stiffness", math.nan), row.get("damping", math.nan)


def test_late_restarted_and_renamed(ros_domain: int) -> None:
    """Issue 5, item 3: late, restarted with other gains, renamed: said, and recovered from."""
    with NodeProcess("monitor", {**PUMA, "controller": "/simulated_joint"}) as monitor, probe() as one:
        one.wait_for_monitor()
        one.wait(lambda: controller(one).startswith("waiting for /simulated_joint; there are /probe"), "the wait")
        assert one.diagnostics["stickslip_monitor"][0] == b"\x01"
        with NodeProcess("simulated_joint", {"rate": 250.0}):
            one.wait(lambda: gains(one) == (630.0, 0.0), "the late controller's gains")
            one.wait(lambda: controller(one) == "following /simulated_joint", "the status of that")
            one.wait(lambda: one.diagnostics["stickslip_monitor"][0] == b"\x00", "all well")
        one.wait(lambda: "waiting" in controller(one), "the loss to be noticed")
        with NodeProcess("simulated_joint", SMOOTH):
            one.wait(lambda: gains(one) == (9000.0, 200.0), "the restarted controller's gains")
        # Under another name it is found again once the monitor is told; what is there is named meanwhile.
        with NodeProcess("simulated_joint", {}, {"__node": "arm_controller"}):
            one.wait(lambda: "/arm_controller" in controller(one), "the name of what is there")
            assert one.set_parameters("/stickslip_monitor", {"controller": "/arm_controller"}) == [""]
            one.wait(lambda: gains(one) == (630.0, 0.0), "the renamed controller's gains")
        refused = one.set_parameters("/stickslip_monitor", {"controller": 5})[0]
        assert "'controller' must be the name of a node, or a list of names: 5" in refused
        assert monitor.running


def test_a_controller_that_answers_slowly_or_never(ros_domain: int) -> None:
    """Issue 5, item 3: the node does not wait, says so, and recovers."""
    with (
        NodeProcess(FAULTY, {"fault": "hang", "fault_after": 1}) as joint,
        NodeProcess("monitor", {**PUMA, "controller": "/simulated_joint"}),
        probe() as one,
    ):
        one.wait_for_monitor()
        one.wait(lambda: gains(one) == (630.0, 0.0), "the gains")
        # Somebody sets a gain, over which the controller hangs for twelve seconds, its services there all the while.
        client = one.node.create_client(ListParameters, "/simulated_joint/list_parameters")
        with pytest.raises(AssertionError, match="the answer of"):
            one.set_parameters("/simulated_joint", {"gains.joint1.p": 800.0}, limit=5.0)
        one.wait(lambda: "has not answered for" in controller(one), "the silence to be noticed")
        assert client.service_is_ready()
        heard = len(one.margin_times)
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            # The controller does not publish either; others do, and a silent system would be told of once a second.
            one.publish(["joint1"], time.time(), position=[0.0])
            one.spin(0.02)
        assert len(one.margin_times) - heard >= 7  # it publishes ten times a second all the same
        one.wait(lambda: gains(one) == (800.0, 0.0), "the gains after the silence")
        one.wait(lambda: controller(one) == "following /simulated_joint", "the end of the silence")
        assert joint.running


def test_several_controllers_and_other_units(ros_domain: int) -> None:
    """Issue 5, item 3: two controllers, a joint each; one's gains, limits and advice are in amperes."""
    scale = 50.0
    parameters = {
        "joints": "[a, b]", "model.a": "puma560_joint1", "model.b": "puma560_joint1", "learn": "false",
        "controller": "[/left, /right]", "gain_scale.b": scale, "effort_scale.b": scale, "limits.b.p_max": 60.0,
        "qos_overrides./joint_states.subscription.reliability": "reliable",
    }  # fmt: skip
    left = {"joints": "[a]", "model.a": "puma560_joint1"}
    right = {"joints": "[b]", "gains.b.p": 630.0 / scale, "velocity.b": 0.0}
    with (
        NodeProcess("simulated_joint", left, {"__node": "left"}),
        # Another topic: its motion is not wanted, only its gains in amperes.
        NodeProcess("simulated_joint", right, {"__node": "right", "joint_states": "others", "joint_references": "x"}),
        NodeProcess("monitor", parameters),
        probe() as one,
    ):
        one.wait_for_monitor()
        one.wait(lambda: gains(one, "a") == (630.0, 0.0), "the left gains")
        one.wait(lambda: gains(one, "b") == pytest.approx((630.0, 0.0)), "the right gains, in SI units")
        assert controller(one) == "following /left; following /right"
        # Joint b moves as joint a does: the same advice, in amperes.
        indices = itertools.count()

        def moves(samples: int) -> None:
            for index in itertools.islice(indices, samples):
                at = 100.0 + 0.01 * index
                one.publish(["b"], at, position=[0.0058 * 0.01 * index], velocity=[0.0058], effort=[9.0 / scale])
                one.spin(0.002)

        moves(200)
        one.wait(lambda: "recommended stiffness [N*m/rad]" in one.diagnostics["b"][2], "advice for b")
        keys, advised, until = {}, [math.nan, math.nan], time.monotonic() + LIMIT
        while not math.isfinite(advised[0] + float(keys.get("recommended stiffness [N*m/rad]", math.nan))):
            # It goes on, as there is no advice for a joint that was silent, or of few samples, on a busy machine.
            assert time.monotonic() < until, keys
            moves(20)
            advised = one.get_parameters("/stickslip_monitor", ["recommended.b.p", "recommended.b.d"])
            keys = one.diagnostics["b"][2]
        assert advised[0] * scale == pytest.approx(float(keys["recommended stiffness [N*m/rad]"]))
        assert advised[1] * scale == pytest.approx(float(keys["recommended damping [N*m*s/rad]"]), abs=1e-9)
        assert advised[0] <= 60.0
        # A change of the scale changes what the gains mean.
        assert one.set_parameters("/stickslip_monitor", {"gain_scale.b": 2 * scale}) == [""]
        one.wait(lambda: gains(one, "b") == pytest.approx((1260.0, 0.0)), "the new meaning")
        assert "must be finite and > 0" in one.set_parameters("/stickslip_monitor", {"gain_scale.b": 0.0})[0]


def test_the_advice_as_parameters(ros_domain: int) -> None:
    """Issue 5, items 1, 2, 6: what `ros2 param get` and `describe` ask for, variants, condition, and gains on trial."""
    with (
        NodeProcess("simulated_joint", {"rate": 250.0}),
        NodeProcess("monitor", {**PUMA, "controller": "/simulated_joint", "limits.joint1.p_max": 8000.0}),
        probe() as one,
    ):
        one.wait_for_monitor()
        names = ["recommended.joint1.p", "recommended.joint1.d"]
        one.wait(lambda: one.recommended is not None, "advice")
        one.wait(lambda: math.isfinite(one.get_parameters("/stickslip_monitor", names)[0]), "the parameters")
        steady = one.get_parameters("/stickslip_monitor", names)
        for descriptor, unit, least in zip(
            one.describe("/stickslip_monitor", names), ("N*m/rad", "N*m*s/rad"), "00", strict=True
        ):
            assert f"[{unit}]" in descriptor.description
            assert f"range {least} to " in descriptor.description
            assert "set the controller's gains instead" in descriptor.additional_constraints
        assert "to 8000" in one.describe("/stickslip_monitor", names)[0].description
        assert one.set_parameters("/stickslip_monitor", {"limits.joint1.p_max": 9000.0}) == [""]
        assert "to 9000" in one.describe("/stickslip_monitor", names)[0].description

        one.wait(lambda: "advice, least change" in one.diagnostics["joint1"][2], "the advice within the new limit")
        keys = one.diagnostics["joint1"][2]
        assert keys["advice, least change"] == keys["recommendation"]
        assert keys["advice, damping only"].startswith("raise the damping")
        assert float(keys["damping_only damping [N*m*s/rad]"]) == pytest.approx(131.9, rel=0.02)
        assert float(keys["damping_only stiffness [N*m/rad]"]) == 630.0
        assert keys["advice, stiffness only"].endswith("within these limits: largest stiffness, least damping ratio")
        assert "lag × " in keys["advice, lubricant and mechanics"]
        assert float(keys["reserve elasticity to stribeck [1]"]) < 0

        assert one.set_parameters("/stickslip_monitor", {"variant": "damping_only"}) == [""]
        one.wait(lambda: one.get_parameters("/stickslip_monitor", names)[0] == 630.0, "the other variant")
        assert keys["recommendation is by"] == "exact"
        papers = {"condition": "paper", "steady_sliding": False, "variant": "least_change"}
        assert one.set_parameters("/stickslip_monitor", papers) == ["", "", ""]
        one.wait(lambda: one.diagnostics["joint1"][2].get("recommendation is by") == "paper", "the paper's condition")
        # Eq. (43) asks for other gains than the integration.
        one.wait(lambda: abs(one.get_parameters("/stickslip_monitor", names)[1] / steady[1] - 1.0) > 0.1, "its gains")
        assert "one of paper, exact" in one.set_parameters("/stickslip_monitor", {"condition": "guess"})[0]
        assert "one of least_change" in one.set_parameters("/stickslip_monitor", {"variant": "none"})[0]

        assert one.set_parameters("/stickslip_monitor", {"trial.joint1.p": 6000.0, "trial.joint1.d": 50.0}) == ["", ""]
        one.wait(lambda: one.margins["joint1"]["trial_energy_margin"] > 0, "the margin on trial")
        one.wait(lambda: one.margins["joint1"]["trial_exact_smooth"] == 1.0, "the exact verdict on trial")
        row = one.margins["joint1"]
        assert row["energy_margin"] < 0
        assert row["trial_damping_ratio"] > row["trial_critical_damping_ratio"]
        assert gains(one) == (630.0, 0.0)
        assert one.diagnostics["joint1"][2]["trial stiffness [N*m/rad]"] == "6000.0"


def test_the_configuration_names_every_parameter(ros_domain: int) -> None:
    """Issue 5, item 3: config/monitor.yaml starts the node, and holds every parameter that it has."""
    path = ROOT / "config" / "monitor.yaml"
    written = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]

    def flat(tree: dict[str, object], prefix: str = "") -> set[str]:
        found: set[str] = set()
        for key, value in tree.items():
            found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key}
        return found

    with NodeProcess("monitor", {}, params_file=path), probe() as one:
        one.wait_for_monitor()
        client = one.node.create_client(ListParameters, "/stickslip_monitor/list_parameters")
        one.known(client, "the parameter services")
        future = client.call_async(ListParameters.Request())
        one.wait(future.done, "the names")
        rcl = ("use_sim_time", "start_type_description_service", "qos_overrides.")
        declared = {name for name in future.result().result.names if not name.startswith(rcl)}
        assert flat(written) == {name for name in declared if not name.startswith("recommended.")}
