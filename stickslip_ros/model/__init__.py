# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The physics: friction, dimensionless groups, the condition for smooth motion, simulation.

Pure functions and frozen dataclasses; imports nothing of the floors above, no ROS, no files.
"""
