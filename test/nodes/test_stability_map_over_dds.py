# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The pictures that the monitor publishes, over real DDS."""

from __future__ import annotations

import io

from matplotlib.image import imread
from nodes.forked_nodes import NodeProcess
from nodes.support_ros import Probe, probe
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CompressedImage

KNOWN = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false", "controller": "/simulated_joint"}


class Viewer:
    """Looks at `~/stability_map`, as a latched topic or as one that is not."""

    def __init__(self, one: Probe, *, latched: bool) -> None:
        self.images: list[CompressedImage] = []
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=10, durability=durability)
        one.node.create_subscription(CompressedImage, "/stickslip_monitor/stability_map", self.images.append, qos)


def test_a_picture_of_a_joint_that_sticks(ros_domain: int) -> None:
    """Issue 8: `~/stability_map` shows a joint that sticks, again on change, and to whoever comes later."""
    with NodeProcess("simulated_joint", {"rate": 250.0}), NodeProcess("monitor", KNOWN), probe() as one:
        one.wait_for_monitor()
        first = Viewer(one, latched=True)
        one.wait(lambda: len(first.images) > 0, "a picture")
        image = first.images[0]
        assert (image.format, image.header.frame_id) == ("png", "joint1")
        pixels = imread(io.BytesIO(bytes(image.data)), format="png")
        assert min(pixels.shape[:2]) > 500
        assert pixels[..., :3].std() > 0.05, "an empty picture"
        late = Viewer(one, latched=False)
        one.wait(lambda: len(late.images) > 0, "the picture for who comes later")
        assert bytes(late.images[-1].data) == bytes(first.images[-1].data)
        assert one.set_parameters("/simulated_joint", {"gains.joint1.p": 1500.0}) == [""]
        seen = bytes(first.images[-1].data)
        one.wait(lambda: bytes(first.images[-1].data) != seen, "a picture with the new gains")


def test_a_joint_that_needs_none_has_none(ros_domain: int) -> None:
    """Issue 8: no picture of a joint that moves smoothly."""
    smooth = {"gains.joint1.p": 3000.0, "gains.joint1.d": 250.0, "velocity.joint1": 0.05, "rate": 250.0}
    with NodeProcess("simulated_joint", smooth), NodeProcess("monitor", KNOWN), probe() as one:
        one.wait_for_monitor()
        viewer = Viewer(one, latched=True)
        one.wait(lambda: one.status("joint1") == "smooth", "smooth motion")
        one.spin(5.0)
        assert viewer.images == []
