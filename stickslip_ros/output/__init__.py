# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is said of a joint: statuses, tables, JSON, pictures."""
