# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""An arm's joint states on a topic: python -m benchmarks.joint_stream JOINTS RATE SECONDS [STICKING [RESTING]].

The motion is worked out beforehand and the messages are serialized once, so that the publisher takes as little of the
machine as it can. Where the last part of the motion ends, it goes on from there. Prints how many messages it sent.
"""

from __future__ import annotations

import struct
import sys
import time

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from stickslip_ros.messages.joint_states import places_of_values
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.settings.known_joints import load_joint

_START, _LOOP = 5.0, 20.0  # [s] of motion that is left out, and that is repeated
_AT_ONCE = 0.001  # [s] what is due by then is sent together, as nobody sleeps for less
_SPEED, _RESOLUTION = 0.005, 2.5e-5
_STAMP_AT = 4


def motion(rate: float, gains: Gains) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of one loop of a joint's motion, its start from rest left out."""
    times = np.arange(int((_LOOP + _START) * rate)) / rate
    found = simulate(
        load_joint("puma560_joint1").joint, gains, _SPEED * times, np.full(times.shape, _SPEED), period=1.0 / rate
    )
    loop = slice(int(_START * rate), len(times))
    return _RESOLUTION * np.round(found.position[loop] / _RESOLUTION), found.velocity[loop]


def main(joints: int, rate: float, seconds: float, sticking: int, resting: int = 0) -> int:
    """Publish for so many seconds; returns the number of messages."""
    loose, stiff = motion(rate, Gains(stiffness=630.0)), motion(rate, Gains(stiffness=6300.0, damping=150.0))
    chosen = [loose if number < sticking else stiff for number in range(joints)]
    positions, velocities = (np.stack([one[part] for one in chosen], axis=1) for part in (0, 1))
    positions[:, joints - resting :] = velocities[:, joints - resting :] = 0.0
    way = positions[-1] - positions[0] + _SPEED / rate
    way[joints - resting :] = 0.0
    template = JointState(name=[f"joint{n + 1}" for n in range(joints)])
    template.header.frame_id = "base"
    template.position = template.velocity = [0.0] * joints
    data = bytearray(serialize_message(template))
    places = places_of_values(bytes(data))
    rclpy.init(args=[])
    node = Node("joint_stream")
    publisher = node.create_publisher(JointState, "joint_states", QoSProfile(depth=1000))
    until = time.monotonic() + 30.0
    while publisher.get_subscription_count() == 0 and time.monotonic() < until:
        time.sleep(0.05)
    begin, period, total = time.time_ns(), 1e9 / rate, int(seconds * rate)
    sent = 0
    while sent < total:
        due = min(total, int((time.time_ns() - begin) / period) + 1)
        for number in range(sent, due):
            loop, index = divmod(number, len(positions))
            stamp = begin + int(number * period)
            struct.pack_into("<iI", data, _STAMP_AT, stamp // 1_000_000_000, stamp % 1_000_000_000)
            for place, values in zip(places, (positions[index] + loop * way, velocities[index]), strict=True):
                data[place : place + 8 * joints] = values.tobytes()
            publisher.publish(bytes(data))
        sent = due
        time.sleep(_AT_ONCE)
    print(sent, flush=True)
    time.sleep(0.5)
    node.destroy_node()
    rclpy.try_shutdown()
    return sent


if __name__ == "__main__":
    counts = [int(argument) for argument in sys.argv[4:]] or [1]
    main(int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), *counts)
