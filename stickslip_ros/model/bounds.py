# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bounds of every number that comes in: positions, velocities, efforts, references, gains and stamps, in any unit."""

from __future__ import annotations

import numpy as np

# Magnitude of a position [rad], velocity [rad/s], effort [N·m], gain [N·m/rad] or stamp [s], in other units likewise:
# no joint, controller or clock has one, and below it the arithmetic of a fit, which takes fourth powers, stays finite.
LARGEST = 1e12
# Magnitude of a number that is not zero: smaller ones are denormal, which memory that nobody wrote often has.
SMALLEST = float(np.finfo(float).tiny)
# Smallest divisor, in any unit: a zero is replaced by it, so that no quotient is NaN; any sum but of zeros loses it.
TINY = 1e-300
# Change of an effort [N·m]: less in all is no measurement, but zeros, a constant, or what rounding makes of them.
LEAST_EFFORT_CHANGE = 1e-12
