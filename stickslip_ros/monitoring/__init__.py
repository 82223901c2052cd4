# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples to cycles, margin and advice: numpy arrays in, dataclasses out; no ROS, no files, no clock."""
