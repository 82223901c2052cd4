# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The few `ros2` commands that README and docs use, for machines that have ROS 2 from wheels, where ros2cli is not.

What they start and call is real: nodes, parameters, services, topics over DDS. Launch files run as they are, on a
stand-in for the part of `launch` that they use.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import rclpy
import yaml
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from stickslip_ros.parent_death import die_with_parent

ROOT = Path(__file__).resolve().parents[1]
_WAIT = 120.0  # [s]


@dataclass
class LaunchContext:
    arguments: dict[str, str]


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str | None = None
    description: str = ""
    choices: Iterable[str] | None = None


@dataclass
class LaunchConfiguration:
    name: str

    def perform(self, context: LaunchContext) -> str:
        return context.arguments[self.name]


@dataclass
class PathJoinSubstitution:
    parts: list[Any]

    def perform(self, context: LaunchContext) -> str:
        return str(Path(*(performed(part, context) for part in self.parts)))


@dataclass
class FindPackageShare:
    package: str

    def perform(self, _: LaunchContext) -> str:
        return share(self.package)


@dataclass
class OpaqueFunction:
    function: Callable[[LaunchContext], list[Any]]


@dataclass
class PythonLaunchDescriptionSource:
    path: Any


@dataclass
class IncludeLaunchDescription:
    source: PythonLaunchDescriptionSource
    launch_arguments: Iterable[tuple[str, Any]] = ()


@dataclass
class Shutdown:
    reason: str


@dataclass
class EmitEvent:
    event: Shutdown


@dataclass
class OnProcessExit:
    target_action: Any
    on_exit: list[EmitEvent]


@dataclass
class RegisterEventHandler:
    handler: OnProcessExit


@dataclass(eq=False)
class Node:
    package: str
    executable: str
    namespace: Any = ""
    parameters: list[Any] = field(default_factory=list)
    remappings: list[tuple[str, Any]] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    output: str = "log"


_MODULES = {
    "launch": (LaunchContext, LaunchDescription),
    "launch.actions": (
        DeclareLaunchArgument, OpaqueFunction, IncludeLaunchDescription, EmitEvent, RegisterEventHandler,
    ),
    "launch.event_handlers": (OnProcessExit,),
    "launch.events": (Shutdown,),
    "launch.launch_description_sources": (PythonLaunchDescriptionSource,),
    "launch.substitutions": (LaunchConfiguration, PathJoinSubstitution),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
    "launch_ros.substitutions": (FindPackageShare,),
    "ament_index_python": (),
    "ament_index_python.packages": (),
}  # fmt: skip


def share(package: str) -> str:
    """Where the package's launch and config folders lie: in the checkout."""
    assert package == "stickslip_ros"
    return str(ROOT)


def performed(value: Any, context: LaunchContext) -> Any:
    """A value, or what a substitution makes of it."""
    return value.perform(context) if hasattr(value, "perform") else value


def stand_in() -> None:
    """Let launch files find what they import."""
    for name, things in _MODULES.items():
        module = sys.modules[name] = ModuleType(name)
        for thing in things:
            setattr(module, thing.__name__, thing)
    sys.modules["ament_index_python.packages"].get_package_share_directory = share  # type: ignore[attr-defined]


def described(path: Path, arguments: dict[str, str]) -> tuple[list[Node], dict[int, str]]:
    """The nodes of a launch file, and which of them end everything when they end, with the reason."""
    spec = importlib.util.spec_from_file_location("launch_file", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    nodes: list[Node] = []
    last: dict[int, str] = {}
    _visit(module.generate_launch_description().entities, LaunchContext(dict(arguments)), nodes, last)
    return nodes, last


def _visit(entities: list[Any], context: LaunchContext, nodes: list[Node], last: dict[int, str]) -> None:
    declared = {entity.name for entity in entities if isinstance(entity, DeclareLaunchArgument)}
    unknown = set(context.arguments) - declared
    assert not declared or not unknown, f"no such launch argument: {', '.join(sorted(unknown))}"
    for entity in entities:
        if isinstance(entity, DeclareLaunchArgument):
            if entity.default_value is None:
                assert entity.name in context.arguments, f"the launch argument {entity.name} is missing"
            else:
                context.arguments.setdefault(entity.name, entity.default_value)
            allowed = list(entity.choices or [context.arguments[entity.name]])
            assert context.arguments[entity.name] in allowed, f"{entity.name} is one of {', '.join(allowed)}"
        elif isinstance(entity, OpaqueFunction):
            _visit(entity.function(context), context, nodes, last)
        elif isinstance(entity, IncludeLaunchDescription):
            passed = {name: performed(value, context) for name, value in entity.launch_arguments}
            more, more_last = described(Path(performed(entity.source.path, context)), passed)
            nodes += more
            last |= more_last
        elif isinstance(entity, RegisterEventHandler):
            last[id(entity.handler.target_action)] = entity.handler.on_exit[0].event.reason
        else:
            nodes.append(performed_node(entity, context))


def performed_node(node: Node, context: LaunchContext) -> Node:
    """A node with all substitutions made."""
    node.namespace = performed(node.namespace, context)
    node.parameters = [performed(part, context) for part in node.parameters]
    node.remappings = [(before, performed(after, context)) for before, after in node.remappings]
    return node


def executable(name: str) -> str:
    """Path of one of the package's executables."""
    path = Path(sys.executable).with_name(name)
    assert path.exists(), f"no executable {name}"
    return str(path)


def command_of(node: Node, folder: Path) -> list[str]:
    """How the node is started; dictionaries of parameters become files, as with launch_ros."""
    assert node.package == "stickslip_ros"
    command = [executable(node.executable), "--ros-args"]
    if node.namespace:
        command += ["-r", f"__ns:=/{node.namespace.strip('/')}"]
    for part in node.parameters:
        path = Path(part) if isinstance(part, str) else folder / f"parameters_{len(list(folder.iterdir()))}.yaml"
        if not isinstance(part, str):
            path.write_text(yaml.safe_dump({"/**": {"ros__parameters": part}}))
        command += ["--params-file", str(path)]
    for before, after in node.remappings:
        command += ["-r", f"{before}:={after}"]
    return command


def launch(package: str, name: str, *arguments: str) -> int:
    """Start what a launch file describes, and end it on SIGINT or when it says so."""
    stand_in()
    given = dict(argument.split(":=", 1) for argument in arguments)
    nodes, last = described(Path(share(package)) / "launch" / name, given)
    if os.environ.get("CHECK_ONLY"):
        own = [node for node in nodes if node.package == "stickslip_ros"]
        return 0 if all(executable(node.executable) for node in own) else 1
    with tempfile.TemporaryDirectory() as folder:
        processes = {
            id(node): subprocess.Popen(command_of(node, Path(folder)), preexec_fn=die_with_parent) for node in nodes
        }
        try:
            while any(process.poll() is None for process in processes.values()):
                if any(processes[one].poll() is not None for one in last):
                    break
                time.sleep(0.05)
        except KeyboardInterrupt:
            pass
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        return max(process.wait(30.0) for process in processes.values())


def run(package: str, name: str, *arguments: str) -> int:
    """Run one executable."""
    assert package == "stickslip_ros"
    return subprocess.call([executable(name), *arguments], preexec_fn=die_with_parent)


def param(verb: str, node: str, name: str, value: str = "") -> int:
    """Get or set one parameter."""
    return _with_node(lambda one: _param(one, verb, node, name, value))


def _param(one: Any, verb: str, node: str, name: str, value: str) -> int:
    client = AsyncParameterClient(one, node)
    assert client.wait_for_services(_WAIT), f"no node {node}"
    if verb == "get":
        answer = _answer(one, client.get_parameters([name])).values[0]
        assert answer.type != Parameter.Type.NOT_SET.value, f"{node} has no parameter {name}"
        print(answer)
        return 0
    result = _answer(one, client.set_parameters([Parameter(name, value=yaml.safe_load(value))])).results[0]
    print("Set parameter successful" if result.successful else f"Setting parameter failed: {result.reason}")
    return 0 if result.successful else 1


def service(verb: str, name: str, kind: str) -> int:
    """Call a service without arguments; 1 if it answers that it did not succeed."""
    assert verb == "call"
    package, _, type_name = kind.split("/")
    service_type = getattr(import_module(f"{package}.srv"), type_name)

    def call(one: Any) -> int:
        client = one.create_client(service_type, name)
        assert client.wait_for_service(_WAIT), f"no service {name}"
        answer = _answer(one, client.call_async(service_type.Request()))
        print(answer)
        return 0 if answer.success else 1

    return _with_node(call)


def topic(verb: str, once: str, name: str) -> int:
    """Print one message."""
    assert (verb, once) == ("echo", "--once")

    def echo(one: Any) -> int:
        until = time.monotonic() + _WAIT
        while not (kinds := dict(one.get_topic_names_and_types()).get(name)):
            assert time.monotonic() < until, f"no topic {name}"
            rclpy.spin_once(one, timeout_sec=0.1)
        package, _, type_name = kinds[0].split("/")
        heard: list[Any] = []
        one.create_subscription(getattr(import_module(f"{package}.msg"), type_name), name, heard.append, 10)
        while not heard:
            assert time.monotonic() < until, f"nothing on {name}"
            rclpy.spin_once(one, timeout_sec=0.1)
        print(heard[0])
        return 0

    return _with_node(echo)


def _with_node(use: Callable[[Any], int]) -> int:
    rclpy.init(args=[])
    one = rclpy.create_node("ros2_stand_in")
    try:
        return use(one)
    finally:
        one.destroy_node()
        rclpy.try_shutdown()


def _answer(one: Any, future: Any) -> Any:
    rclpy.spin_until_future_complete(one, future, timeout_sec=_WAIT)
    assert future.done(), "no answer"
    return future.result()


_VERBS: dict[str, Callable[..., int]] = {
    "launch": launch, "run": run, "param": param, "service": service, "topic": topic
}  # fmt: skip


def main(words: list[str]) -> int:
    """Do what a command says; returns its exit status."""
    return _VERBS[words[0]](*words[1:])


if __name__ == "__main__":
    try:
        raise SystemExit(main(sys.argv[1:]))
    except AssertionError as error:
        raise SystemExit(f"ros2 (stand-in): {error}") from error
