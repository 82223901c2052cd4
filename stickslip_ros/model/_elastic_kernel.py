# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: a joint at rest on an elastic contact, until that yields. Linear, so that its propagator is exact.

    M x¨ = u(t) − (σ₀ (x − a) + (σ₁ + F_v) x˙),    σ₀ |x − a| ≤ F_k + F_s(t₂)

with a where the contact is without force, and the controller's effort u. The steps are short beside the contact's own
oscillation, so that none of its peaks is missed.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._plant_state import breaks_away, level_at

PROPAGATORS = (2, 3, 3, 3)  # of a whole step and of a part; by order of the input; rows, columns
_TERMS = 16  # terms of the power series of a propagator, 1
_ANGLE = 0.4  # angle of the contact's oscillation in a step, rad
_EXACT = 1e-11  # error of a breakaway's time, of a step


@helper()
def _fill(time, parameters, propagators, which):
    """e^(Bt), ∫ e^(Bs) ds and ∫ (t − s) e^(Bs) ds over (0, t), of position, velocity and integral of the error."""
    inertia = parameters[at.INERTIA]
    spring = (parameters[at.STIFFNESS] + parameters[at.PRESLIDING_STIFFNESS]) / inertia
    damping = (parameters[at.DAMPING] + parameters[at.PRESLIDING_DAMPING] + parameters[at.VISCOUS]) / inertia
    drive = parameters[at.INTEGRAL_GAIN] / inertia
    for j in range(3):
        x, v, z = 1.0 * (j == 0), 1.0 * (j == 1), 1.0 * (j == 2)
        for m in range(3):
            for i in range(3):
                propagators[which, m, i, j] = 0.0
        for n in range(_TERMS):
            once, twice = time / (n + 1), time * time / ((n + 1) * (n + 2))
            propagators[which, 0, 0, j] += x
            propagators[which, 0, 1, j] += v
            propagators[which, 0, 2, j] += z
            propagators[which, 1, 0, j] += once * x
            propagators[which, 1, 1, j] += once * v
            propagators[which, 1, 2, j] += once * z
            propagators[which, 2, 0, j] += twice * x
            propagators[which, 2, 1, j] += twice * v
            propagators[which, 2, 2, j] += twice * z
            x, v, z = once * v, once * (-spring * x - damping * v + drive * z), -once * x


@helper()
def _moved(propagators, which, reference, reference_velocity, state, parameters, out):
    """Position, velocity and integral after a step, into ``out``; the reference at the step's start."""
    # Measured from where the joint is: the contact's force is a small difference of positions otherwise.
    x, v, z = 0.0, state[at.VELOCITY], state[at.INTEGRAL]
    inertia = parameters[at.INERTIA]
    ahead = reference - state[at.POSITION]
    push = (
        parameters[at.STIFFNESS] * ahead
        + parameters[at.DAMPING] * reference_velocity
        - parameters[at.LOAD]
        - parameters[at.PRESLIDING_STIFFNESS] * state[at.DEFLECTION]
    ) / inertia
    growth = parameters[at.STIFFNESS] * reference_velocity / inertia
    for i in range(3):
        out[i] = (
            propagators[which, 0, i, 0] * x
            + propagators[which, 0, i, 1] * v
            + propagators[which, 0, i, 2] * z
            + propagators[which, 1, i, 1] * push
            + propagators[which, 1, i, 2] * ahead
            + propagators[which, 2, i, 1] * growth
            + propagators[which, 2, i, 2] * reference_velocity
        )


@helper()
def _excess_after(moved, time, state, parameters):
    """The contact's force less what it can hold, where the joint has moved by so much at a time."""
    deflection = state[at.DEFLECTION] + moved
    held = parameters[at.COULOMB] + level_at(time, state, parameters)
    return parameters[at.PRESLIDING_STIFFNESS] * abs(deflection) - held


@inlined()
def longest_step(parameters):
    """So short that no peak is missed."""
    inertia = parameters[at.INERTIA]
    spring = abs(parameters[at.STIFFNESS] + parameters[at.PRESLIDING_STIFFNESS]) / inertia
    damping = abs(parameters[at.DAMPING] + parameters[at.PRESLIDING_DAMPING] + parameters[at.VISCOUS]) / inertia
    return _ANGLE / max(np.sqrt(spring), damping)


@helper()
def _accept(step, state, out):
    state[at.TIME] += step
    state[at.POSITION] += out[0]
    state[at.DEFLECTION] += out[0]
    state[at.VELOCITY], state[at.INTEGRAL] = out[1], out[2]


@helper()
def hold_until(end, reference, reference_velocity, state, parameters, propagators, kept, out):
    """Move a joint at rest on its contact until ``end`` or until it breaks away; true if it does.

    ``kept`` has the step that the first propagator is of; nothing is computed anew while that stays.
    """
    start = state[at.TIME]
    steps = int(np.ceil((end - start) / longest_step(parameters) - 1e-9))
    step = (end - start) / max(steps, 1)
    if abs(step - kept[0]) > 1e-9 * step:
        _fill(step, parameters, propagators, 0)
        kept[0] = step
    for i in range(steps):
        time = start + i * step
        ahead = reference + reference_velocity * (time - start)
        _moved(propagators, 0, ahead, reference_velocity, state, parameters, out)
        high = -1.0
        before, after = state[at.VELOCITY], out[1]
        if _excess_after(out[0], time + step, state, parameters) > 0.0:
            high = step
        elif before * after < 0.0:
            # It turns round within the step, where the contact may give way; Hermite's cubic is close enough.
            s = before / (before - after)
            peak = s * s * (3.0 - 2.0 * s) * out[0] + s * (1.0 - s) * step * ((1.0 - s) * before - s * after)
            if _excess_after(peak, time + s * step, state, parameters) > 0.0:
                high = s * step
        if high < 0.0:
            _accept(step, state, out)
            continue
        low = 0.0
        while high - low > _EXACT * step:
            middle = 0.5 * (low + high)
            _fill(middle, parameters, propagators, 1)
            _moved(propagators, 1, ahead, reference_velocity, state, parameters, out)
            if _excess_after(out[0], time + middle, state, parameters) > 0.0:
                high = middle
            else:
                low = middle
        _fill(high, parameters, propagators, 1)
        _moved(propagators, 1, ahead, reference_velocity, state, parameters, out)
        _accept(high, state, out)
        breaks_away(state[at.TIME], 1.0 if state[at.DEFLECTION] > 0.0 else -1.0, state, parameters)
        return True
    state[at.TIME] = end
    return False
