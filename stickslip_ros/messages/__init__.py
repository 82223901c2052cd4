# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What live and recorded messages share: content, layouts, decoding in blocks."""
