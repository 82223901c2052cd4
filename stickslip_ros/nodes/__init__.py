# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The ROS 2 edge: nodes and what they need to talk to the graph."""
