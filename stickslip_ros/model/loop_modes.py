# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Modes of the linear loop: a joint with viscous friction and no other, rigid or of two masses, and its controller."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint, Transmission

# Excess of an eigenvalue's magnitude over 1, 1: what rounding makes of a mode that neither grows nor decays.
_ON_THE_CIRCLE = 1e-9


def loop_matrix(joint: Joint, gains: Gains, conditions: OperatingConditions) -> NDArray[np.float64]:
    """What a period of a sampled controller does to the loop's state, or the slopes of that under continuous control.

    The state is position and velocity of the joint, or of motor and load, the integral of the error where there is
    integral action, and what is late: the effort that waits, or two states of the actuation delay (Padé's approximation
    of order two, good to three radians).

    Parameters
    ----------
    joint : of scalars. gains : scalars, or arrays of one shape, which then is that of the first axes of what is
        returned.
    """
    period, transmission = conditions.controller_period, joint.transmission
    plant = _plant(float(joint.inertia), float(joint.friction.viscous), transmission, period)
    size, seen = len(plant) - 1, 2 if transmission is not None and transmission.on_load else 0
    delay = float(joint.actuation_delay) if period == 0 else 0.0
    integral = size if np.any(gains.integral) else -1
    first_late = size + (integral >= 0)
    states = first_late + (2 if delay > 0 else int(conditions.control_delay))
    stiffness, damping, drive = np.broadcast_arrays(gains.stiffness, gains.damping, gains.integral)
    effort = np.zeros((*stiffness.shape, states))
    effort[..., seen], effort[..., seen + 1] = -stiffness, -damping
    loop = np.zeros((*stiffness.shape, states, states))
    if integral >= 0:
        effort[..., integral] = drive
        loop[..., integral, seen] = -(period or 1.0)
        if period > 0:
            loop[..., integral, integral] = 1.0
            effort[..., seen] -= drive * period
    applied = effort
    if conditions.control_delay:
        loop[..., first_late, :] = effort
        applied = np.eye(states)[first_late]
    elif delay > 0:
        loop[..., first_late, first_late + 1] = 1.0
        loop[..., first_late + 1, :] = effort
        loop[..., first_late + 1, first_late] -= 12.0 / delay**2
        loop[..., first_late + 1, first_late + 1] -= 6.0 / delay
        applied = effort - 12.0 / delay * np.eye(states)[first_late + 1]
    loop[..., :size, :size] += plant[:size, :size]
    loop[..., :size, :] += plant[:size, size:] * applied[..., None, :]
    return loop


def loop_is_unstable(joint: Joint, gains: Gains, conditions: OperatingConditions) -> bool:
    """Whether the linear loop, viscous friction in it and no other, has a mode that grows; scalars only.

    With continuous control of a rigid joint the roots of M s³ + (k_v + F_v) s² + k_p s + k_i, by Routh, F_v less what
    an actuation delay takes off; otherwise the eigenvalues of :func:`loop_matrix`.
    """
    if conditions.controller_period > 0 or joint.transmission is not None:
        loop = loop_matrix(joint, gains, conditions)
        if not np.isfinite(loop).all():
            return True
        modes = np.linalg.eigvals(loop)
        if conditions.controller_period > 0:
            return bool(np.abs(modes).max() > 1.0 + _ON_THE_CIRCLE)
        return bool(modes.real.max() > _ON_THE_CIRCLE * np.abs(modes).max())
    inertia, stiffness, integral = float(joint.inertia), float(gains.stiffness), float(gains.integral)
    damping = float(joint.total_damping(gains))
    return damping < 0 or stiffness < 0 or integral < 0 or damping * stiffness < inertia * integral


def least_modal_damping(joint: Joint, gains: Gains, conditions: OperatingConditions) -> NDArray[np.float64]:
    """Least damping ratio of a mode of the loop, of the gains' shape; negative where one grows."""
    modes = np.linalg.eigvals(loop_matrix(joint, gains, conditions)).astype(complex)
    with np.errstate(all="ignore"):
        if conditions.controller_period > 0:
            modes = np.log(modes)
        ratios = -modes.real / np.abs(modes)
    # What decays at once has no ratio.
    return np.asarray(np.nan_to_num(ratios, nan=1.0).min(axis=-1))


@lru_cache(maxsize=64)
def _plant(inertia: float, viscous: float, transmission: Transmission | None, period: float) -> NDArray[np.float64]:
    """Slopes of the states of a joint, with the effort as the last one; or what a period > 0 does to them."""
    if transmission is None:
        plant = np.array([[0.0, 1.0, 0.0], [0.0, -viscous / inertia, 1.0 / inertia], np.zeros(3)])
    else:
        (motor, load), (spring, damping) = transmission.masses(inertia), transmission.spring(inertia)
        pull = np.array([-spring, -damping, spring, damping, 0.0])
        own = np.array([0.0, -viscous, 0.0, 0.0, 1.0])
        plant = np.array([np.eye(5)[1], (pull + own) / motor, np.eye(5)[3], -pull / load, np.zeros(5)])
    if period == 0:
        return plant
    from scipy.linalg import expm

    with np.errstate(all="ignore"):
        return np.asarray(expm(period * plant))
