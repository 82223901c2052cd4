# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node was told and cannot use: in the log once, in its own status, and as the reason in the joint's."""

from __future__ import annotations

import math
import os
import signal
import time
from pathlib import Path

import pytest
import rclpy
from conftest import LIMIT, nightly
from nodes.forked_nodes import NodeProcess
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support_ros import Probe, probe

from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.settings.parameter_names import unknown_name

PUMA = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false", "state_file": "none"}
NODE = "stickslip_monitor"


def own(one: Probe) -> str:
    """The node's own status."""
    return one.diagnostics.get(NODE, (b"", "", {}))[1]


def joint_line(one: Probe, joint: str = "joint1") -> str:
    """A joint's line."""
    return one.diagnostics.get(joint, (b"", "", {}))[1]


def test_another_type_on_the_references(ros_domain: int) -> None:
    """Issue 15: what is really published on joint_references, and which parameter disagrees."""
    with NodeProcess("monitor", {**PUMA, "gains.joint1.p": 630.0}) as monitor, probe() as one:
        one.wait_for_monitor()
        # The probe publishes JointStates there: that is no reason for a complaint. A participant has one type a topic.
        context = Context()
        rclpy.init(args=[], context=context)
        leader = Node("leader", context=context)
        leader.create_publisher(String, "joint_references", 10)
        text = (
            "/joint_references carries std_msgs/msg/String from /leader, and reference_type is JointState: "
            "remap joint_references, as no reference_type reads that"
        )
        one.wait(lambda: text in own(one), "the node's status")
        one.publish_until(lambda: f"no reference: {text}" in joint_line(one), "the joint's")
        assert one.diagnostics["joint1"][2]["missing"].startswith("no reference: ")
        assert one.diagnostics[NODE][2]["topics of another type"] == text
        one.spin(2.5)
        assert monitor.output().count(text) == 1
        leader.destroy_node()
        context.shutdown()
        one.wait(lambda: text not in own(one), "the end of it")
        one.wait(lambda: text not in joint_line(one), "the end of it in the joint's line")


def test_references_by_another_clock(ros_domain: int) -> None:
    """References that are never used are no silent loss: the joint's line says by how much their stamps are off."""
    with NodeProcess("monitor", PUMA), probe() as one:
        one.wait_for_monitor()
        begun = time.monotonic()
        text = "no reference: the stamps of its references are 95.0 s behind those of its joint states"

        def said(behind: float) -> bool:
            at = 100.0 + time.monotonic() - begun
            message = JointState(name=["joint1"], position=[0.0])
            message.header.stamp = stamp(at - behind)
            one.references.publish(message)
            one.publish(["joint1"], at, position=[0.0])
            return text in joint_line(one)

        one.wait(lambda: said(95.0), "the joint's line")
        one.wait(lambda: not said(0.0), "the end of it")


def test_a_controller_that_is_not_there(ros_domain: int) -> None:
    """Issue 15: the joint's own line says that the gains are waited for, the log says it once."""
    with NodeProcess("monitor", {**PUMA, "controller": "/nobody"}) as monitor, probe() as one:
        one.wait_for_monitor()
        # Before any sample, as after one.
        one.wait(lambda: joint_line(one).startswith("no data yet; gains not known: waiting for /nobody"), "why")
        one.publish_until(lambda: "no data yet" not in joint_line(one), "a sample")
        # The names of others are looked up once a second, and are known some time after their topics.
        waiting = "gains not known: waiting for /nobody; there are /probe"
        one.wait(lambda: waiting in joint_line(one), waiting)
        assert "waiting for /nobody" in own(one)
        one.wait(lambda: "waiting for /nobody" in monitor.output(), "the log")
        one.spin(2.0)
        assert monitor.output().count("waiting for /nobody") == 1
        assert one.set_parameters(f"/{NODE}", {"controller": ""}) == [""]
        one.wait(lambda: "waiting for" not in joint_line(one), "the end of it")
        _gains_elsewhere(one, monitor)


def _gains_elsewhere(one: Probe, monitor: NodeProcess) -> None:
    """Issue 34, item 11: what a controller has, what is taken of it, and what is not, and why; the probe is one."""
    for name, value in (("joints", ["joint1"]), ("k_q_p", [100.0]), ("d", [1.0])):
        one.node.declare_parameter(name, value)
    assert one.set_parameters(f"/{NODE}", {"controller": "/probe"}) == [""]
    elsewhere = (
        "/probe has no parameters gains.<joint>.p/.i/.d of the joints watched; k_q_p, d look like gains, "
        "and gains.<joint>.p, .i and .d are read"
    )
    one.wait(lambda: f"gains not known: {elsewhere}" in joint_line(one), "arrays")
    one.node.declare_parameter("gains.elbow.p", 5.0)
    one.wait(lambda: "of the joints watched; it has those of elbow" in joint_line(one), "another's")
    # 1/s are no N·m/rad.
    one.node.declare_parameter("command_interfaces", ["velocity"])
    one.node.declare_parameter("gains.joint1.p", 630.0)
    one.wait(lambda: "/probe: command_interfaces is velocity: gains beside it" in joint_line(one), "a velocity")
    assert "have the unit 1/s, not N·m/rad" in own(one)
    assert math.isnan(one.margins["joint1"]["stiffness"])
    one.node.set_parameters([Parameter("command_interfaces", value=["effort"])])
    one.wait(lambda: one.margins["joint1"]["stiffness"] == 630.0, "an effort")
    one.wait(lambda: "following /probe: gains.joint1.p" in monitor.output(), "what was taken")
    assert monitor.output().count(elsewhere) == 1
    # What is read again every second is said once in the log, and stands in the node's status.
    one.node.declare_parameter("gains.joint1.i", math.nan)
    refused = "refused: gain i of joint1 in /probe is not finite"
    one.wait(lambda: refused in own(one), "a gain that is none")
    one.spin(2.5)
    assert monitor.output().count("gain i of joint1") == 1
    # And while the gains are in use.
    one.node.set_parameters([Parameter("command_interfaces", value=["position"])])
    one.wait(lambda: math.isnan(one.margins["joint1"]["stiffness"]), "a position")


IMPOSSIBLE = [
    f"/{NODE}",
    "bad name!",
    "/a//b",
    "9",
    "/a/",
    "x" * 300,
    "{x}",
    ["/a", "/a"],
    ["/a", "no way"],
    5,
    0.5,
    True,
]


def test_impossible_names_at_runtime_are_refused(ros_domain: int) -> None:
    """Issue 15: every name of a controller that cannot be has its answer, and the node goes on as before."""
    with (
        NodeProcess("simulated_joint", {"rate": 250.0}),
        NodeProcess("monitor", {**PUMA, "controller": "/simulated_joint"}) as monitor,
        probe() as one,
    ):
        one.wait_for_monitor()
        one.wait(lambda: one.margins.get("joint1", {}).get("stiffness") == 630.0, "the controller's gains")
        for name in IMPOSSIBLE:
            (reason,) = one.set_parameters(f"/{NODE}", {"controller": name})
            assert reason.startswith("'controller' must be "), name
            assert len(reason) < 500
        assert one.diagnostics[NODE][2]["controller"] == "following /simulated_joint"
        one.margin_times.clear()
        assert one.set_parameters("/simulated_joint", {"gains.joint1.p": 700.0}) == [""]
        one.wait(lambda: one.margins["joint1"]["stiffness"] == 700.0, "ticks as before")
        assert "Traceback" not in monitor.output()


def test_deleted_parameters_have_an_answer(ros_domain: int) -> None:
    """Issue 15: `ros2 param delete` on any parameter of any of the nodes is answered."""
    with NodeProcess("simulated_joint", {"rate": 250.0}), NodeProcess("monitor", PUMA) as monitor, probe() as one:
        one.wait_for_monitor()
        for node, names in (
            (NODE, ("controller", "apply_rate", "warn_margin", "gains.joint1.p", "learn", "recommended.joint1.p")),
            ("simulated_joint", ("gains.joint1.p", "profile.joint1", "velocity.joint1")),
        ):
            client = one.node.create_client(SetParameters, f"/{node}/set_parameters")
            one.known(client, "the service")
            for name in names:
                message = ParameterMessage(name=name, value=ParameterValue())
                future = client.call_async(SetParameters.Request(parameters=[message]))
                one.wait(future.done, f"the answer on {name}")
                assert not future.result().results[0].successful, name
        one.diagnostics.clear()
        one.wait(lambda: NODE in one.diagnostics, "ticks as before")
        assert "Traceback" not in monitor.output()


@pytest.mark.parametrize(
    ("module", "parameters", "text"),
    [
        ("monitor", {"controller": "'bad name!'"}, "'controller' must be a name that a node can have (invalid node"),
        nightly("monitor", {"controller": "[/a, /a]"}, "'controller' must be names of different nodes"),
        nightly("monitor", {"joints": "[a, a]"}, "'joints' must be [''], or different names"),
        nightly("monitor", {"joints": "[a, '']"}, "'joints' must be [''], or different names"),
        nightly("monitor", {"joints": "['a,b']"}, "'joints' must be [''], or different names"),
        nightly("monitor", {"publish_rate": ".nan"}, "'publish_rate' must be finite and > 0"),
        nightly("monitor", {"state_file": "x" * 400}, "'state_file' must be the name of a file"),
        ("monitor", {"qos_overrides./joint_states.subscription.reliability": "banana"},
         "qos_overrides./joint_states.subscription: Unexpected QoS override for policy `reliability`: `banana`"),
        nightly("monitor", {"qos_overrides./joint_states.subscription.depth": "-4"},
         "qos_overrides./joint_states.subscription: "),
        nightly("monitor", {"joints": "[a]", "inertia.a": "-1.0"}, "'inertia.a' must be finite and > 0: -1.0"),
        nightly("monitor", {"joints": "[a]", "model.a": "puma"}, "model.a: unknown joint 'puma'"),
        ("simulated_joint", {"rate": ".inf"}, "'rate' must be finite and > 0"),
        nightly("simulated_joint", {"time_factor": "-1.0"}, "'time_factor' must be finite and > 0"),
        nightly("simulated_joint", {"joints": "[a, a]"}, "'joints' must be one or more different names"),
        nightly("simulated_joint", {"profile.joint1": "waltz"},
                "'profile.joint1' must be one of hold, move, reverse: waltz"),
        nightly("simulated_joint", {"velocity.joint1": ".nan"}, "'velocity.joint1' must be finite"),
        nightly("simulated_joint", {"load.joint1": ".inf"}, "'load.joint1' must be finite"),
        nightly("simulated_joint", {"seed": "-1"}, "'seed' must be finite and >= 0"),
        nightly("replay", {"time_factor": ".nan"}, "'time_factor' must be finite and > 0"),
        ("replay", {"linger": "-1.0"}, "'linger' must be finite and >= 0"),
    ],
)  # fmt: skip
def test_impossible_values_at_the_start(ros_domain: int, module: str, parameters: dict[str, object], text: str) -> None:
    """Issue 15: one line that names the parameter and what would be right, and exit status 2."""
    with NodeProcess(module, parameters) as node:
        assert node.wait(LIMIT) == 2
        assert text in node.output()
        assert "Traceback" not in node.output()


def test_slips_of_the_pen_in_a_parameter_file(ros_domain: int, tmp_path: Path) -> None:
    """Issue 15: unknown parameters, joints and sections are named, with what was meant; others' are not."""
    path = tmp_path / "robot.yaml"
    path.write_text(
        "controller_manager: {ros__parameters: {update_rate: 100}}\n"
        "stickslip_monitor: {ros__parameters: {joints: [joint1], alow_apply: true, state_file: none,\n"
        "  limits: {jiont1: {p_max: 1.0}}}}\n"
        "stickslip_monitr: {ros__parameters: {learn: false}}\n"
        # Issue 34, item 11: gains of every node that are elsewhere, and of a joint that is listed twice.
        "/**:\n  ros__parameters:\n    k_q_p: [630.0]\n    rate: 100\n    gains:\n"
        "      joint1: {p: 630.0}\n      joint1: {p: 700.0}\n"
    )
    with NodeProcess("monitor", {}, params_file=path) as monitor, probe() as one:
        one.wait_for_monitor()
        texts = (
            "parameter 'alow_apply' is not known; did you mean 'allow_apply'?",
            "'limits.jiont1.p_max' names the joint 'jiont1', which is not watched; did you mean 'joint1'?",
            "section 'stickslip_monitr' is of no node that is known; did you mean 'stickslip_monitor'?",
            "parameter 'k_q_p' is not known; of gains, gains.<joint>.p, .i and .d are read",
            f"parameter file {path}: must have 'joint1' once: it is in line 10 and in line 11",
        )
        one.wait(lambda: all(text in own(one) for text in texts), "the node's status")
        assert one.diagnostics[NODE][0] == b"\x01"
        one.spin(1.5)
        for text in texts:
            assert monitor.output().count(text) == 1
        assert "update_rate" not in monitor.output()
        assert "'rate'" not in monitor.output()
        assert "controller_manager" not in monitor.output()


def test_no_parameter_of_the_node_is_called_unknown(ros_domain: int) -> None:
    """Issue 15: typing errors are told from a list of the names that there are; the running node has no others."""
    with NodeProcess("monitor", PUMA) as monitor, probe() as one:
        one.wait_for_monitor()
        client = one.node.create_client(ListParameters, f"/{NODE}/list_parameters")
        one.known(client, "the service")
        future = client.call_async(ListParameters.Request())
        one.wait(future.done, "the names")
        names = list(future.result().result.names)
        assert len(names) > 30
        unknown = [name for name in names if unknown_name(name, ["joint1"]) and not name.startswith("recommended.")]
        assert unknown == []
        assert "not known" not in monitor.output()


def test_a_joint_that_comes_later_is_no_slip_of_the_pen(ros_domain: int) -> None:
    """Issue 15: where all joints are watched, a parameter's joint may come; what was said is taken back then."""
    parameters = {"load.elbow": 0.0, "state_file": "none", "publish_rat": 5.0}
    with NodeProcess("monitor", parameters) as monitor, probe() as one:
        one.wait_for_monitor()
        text = "'load.elbow' names the joint 'elbow', which has not been heard of yet"
        one.wait(lambda: "parameter 'publish_rat' is not known; did you mean 'publish_rate'?" in own(one), "a slip")
        one.wait(lambda: text in own(one), "the joint waited for")
        one.publish(["elbow"], 100.0, position=[0.0])
        one.wait(lambda: text not in own(one), "the end of it")
        assert "'publish_rat' is not known" in own(one)
        assert "the joint 'elbow' is heard now" in monitor.output()
        assert monitor.output().count(text) == 1


def test_one_delay_is_called_one(ros_domain: int) -> None:
    """Issue 15: a node that was held up for a moment does not blame the number of its joints."""
    with NodeProcess("monitor", PUMA) as monitor, probe() as one:
        one.wait_for_monitor()
        said = []
        for attempt in range(5):
            # What is late is what had come, and was in no status yet: some of this is.
            for index in range(30):
                one.publish(["joint1"], 100.0 + attempt + 0.005 * index, position=[0.0])
                one.spin(0.005)
            os.kill(monitor.pid, signal.SIGSTOP)
            time.sleep(0.6)
            os.kill(monitor.pid, signal.SIGCONT)
            for _ in range(30):
                one.spin(0.1)
                if "late: " in own(one):
                    break
            said.append(own(one))
            if "late: " in said[-1]:
                break
        assert "statuses were up to 0." in said[-1], said
        assert "joint" not in said[-1].replace("joint_", ""), said
        assert math.isfinite(float(one.diagnostics[NODE][2]["processor [%]"]))
