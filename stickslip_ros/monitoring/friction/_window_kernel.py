# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled simulation of measured slips from their own starts; :mod:`.slip_problem` is its face.

A joint that does not turn is a linear system under the Stribeck friction of one lag ago. It is advanced in steps,
exactly but for the friction and the controller's force, which are polynomials in a step. The velocity one lag ago is
a polynomial too, of an earlier step or, where the lag is shorter than a step, of the same one. One step ends a lag
after breakaway, where the friction begins to fall and may fall at once. From there on steps are halved where the
friction changes within them: at a few Stribeck velocities. At nodes no step ends, so that positions are smooth in the
parameters; positions at nodes follow a polynomial of degree five.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.model import _friction_law
from stickslip_ros.model._linear_step import fill_polynomial, fill_step, lobatto_points

# Indices of the fitted parameters: those that shape a slip, then those of Eq. (6), from slip to slip; each in the order
# of the table in `model.friction`. Coulomb friction is fitted apart.
SHAPE = ("inertia", "viscous", "stribeck_velocity", "lag")
FITTED = (*SHAPE, "stribeck", "rise_time")
INERTIA, VISCOUS, STRIBECK_VELOCITY, LAG, STRIBECK, RISE_TIME = range(6)
# Columns of a slip's start.
POSITION, BREAKAWAY, LEVEL = range(3)
# Columns of what is found of a slip: the force on the joint at breakaway in the slip's direction, when and where
# it ends, the factor by which the Stribeck friction is less there than at breakaway, and how often it went on again.
HOLDING_FORCE, ARREST, ARREST_POSITION, STRIBECK_FRACTION, WENT_ON = range(5)
FOUND_COLUMNS = WENT_ON + 1
COMPLIANCE, DAMPING = range(2)  # columns of a contact
# Of the slips together: median duration, longest duration, median speed.
USUAL_DURATION, LONGEST_DURATION, USUAL_SPEED = range(3)
# Columns of a variant's steps: the longest one, the longest where the joint hardly moves, and by how much a step may be
# longer for each Stribeck velocity that the joint had one lag ago.
_COARSE, _FINE, _GROWTH = range(3)

# Steps: parts of a radian of the spring's, of the time in which speed decays, of that in which the Stribeck friction
# changes, which is that of the speeding up to the Stribeck velocity and some of the lag.
_OF_RADIAN, _OF_DECAY, _OF_CHANGE, _OF_LAG = 0.4, 0.5, 0.25, 0.3
_SPEEDING_UP = 0.25  # time in which the joint comes up to the slip's mean speed, of the slip
_LEAST_RATE, _MOST_RATE = 4.0, 400.0  # steps in a slip, 1: at least, and at most
_MOST_SLIPS = 64  # slips in a window, 1: with more, ever shorter ones, the joint rests as far as can be seen
_MOST_STEPS = 1e5  # steps of a window, 1: at most
# Time in which a slip may end, of the time until the end of its window, 1: encoders do not show the last part.
_LONGEST = 1.5
_ABSURD = 1e50  # way, rad: no further motion is followed
_MOST_SWEEPS = 16  # fixed-point iterations of a step's friction, 1
_NO_STEP = 1e-9  # lag, of a step: a shorter one takes no step of its own
_HALVINGS = 7  # halvings of the longest step, 1: at most
_SETTLED = 1e-12  # change of the Stribeck friction by an iteration, of the level at breakaway

# A step of :mod:`stickslip_ros.model._linear_step`, in which time is counted in steps.
_POINTS = 6  # points of a step, 1
_NODES, _LAGRANGE = lobatto_points(_POINTS)
_LATER = _NODES[1:].copy()  # all but the step's beginning
_IN_FACTORIALS = _LAGRANGE * np.array([[1.0 * math.factorial(k)] for k in range(_POINTS)])  # the same, of s^k/k!

# Rows of a step's matrix: velocity at the points after the first, position at the end.
# Columns: position and velocity at the start, then the force at the points.
_ROWS, _COLUMNS = _POINTS, _POINTS + 2
_END_POSITION = _POINTS - 1

# Helpers, for what is inlined at many places takes numba long to go through.
_risen_level = helper()(_friction_law.risen_level)
_stribeck_friction = helper()(_friction_law.stribeck_friction)


@helper()
def _fill_weights(share, weights, row):
    """Weights of the values at a step's points in the polynomial through them, at a share of the step."""
    points = weights.shape[1]
    for j in range(points):
        total = 0.0
        for k in range(points - 1, -1, -1):
            total = total * share + _LAGRANGE[k, j]
        weights[row, j] = total


@inlined()
def _first_not_positive(values, coefficients, point):
    """Share of a step at which the polynomial through the points falls to zero, seen first not to be above it at one.

    ``values`` are those at the points.
    """
    points = values.shape[0]
    low, high = _NODES[point - 1], _NODES[point]
    if values[point - 1] <= 0.0:
        return low
    share = 0.5 * (low + high)
    for _ in range(60):
        value, slope = 0.0, 0.0
        for k in range(points - 1, -1, -1):
            slope = slope * share + value
            value = value * share + coefficients[k]
        if value > 0.0:
            low = share
        else:
            high = share
        following = share - value / slope if slope < 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - share)
        share = following
        if moved < 1e-13:
            break
    return share


@helper()
def _at(time, node, times, values):
    """A value at ``time`` on the line through a node and the next."""
    share = (time - times[node]) / (times[node + 1] - times[node])
    return values[node] + (values[node + 1] - values[node]) * share


@inlined()
def _next_breakaway(arrest, held, level, stribeck, rise_time, direction, node, last, times, drives):
    """When a joint at rest since an arrest breaks away, and the node before; after the last node if it does not.

    ``held`` is what holds it beside the Stribeck friction, in the slip's direction: kinetic friction and spring.
    """
    low = arrest
    if direction * _at(arrest, node, times, drives) - held > level:
        return arrest, node
    while node < last:
        high = times[node + 1]
        if direction * drives[node + 1] - held > _risen_level(level, stribeck, high - arrest, rise_time):
            # What is missing is concave in time between nodes, so there is one crossing.
            for _ in range(50):
                middle = 0.5 * (low + high)
                force = direction * _at(middle, node, times, drives) - held
                if force > _risen_level(level, stribeck, middle - arrest, rise_time):
                    high = middle
                else:
                    low = middle
            return high, node
        low = high
        node += 1
    return math.inf, node


@helper()
def _fill_lagged_weights(lag, weights):
    """Weights of a step's points in the velocity one lag ago, for each point where that lies in the same step.

    ``lag`` is in steps.
    """
    for j in range(1, weights.shape[0]):
        if _NODES[j] >= lag:
            _fill_weights(_NODES[j] - lag, weights, j)


@helper()
def _step_at(time, index, done, spans):
    """The step in which a time after breakaway lies, of those that are done; from the one of an earlier time on."""
    while index + 1 < done and spans[index + 1, 0] <= time:
        index += 1
    return index


@helper()
def _velocity(time, index, spans, polynomials):
    """Velocity at a time after breakaway in a step that is done, by its polynomial."""
    share = (time - spans[index, 0]) / spans[index, 1]
    total = 0.0
    for k in range(polynomials.shape[1] - 1, -1, -1):
        total = total * share + polynomials[index, k]
    return total


@helper()
def _weighted(values, weights, row):
    """Velocity in a step, by the weights of its points."""
    points = weights.shape[1]
    total = 0.0
    for i in range(points):
        total += weights[row, i] * values[i]
    return total


@helper()
def _slide(
    begin, surplus, creep, level, drive, stiffness, drag, law, plant, steps, direction, rest, node, last, times, drives,
    filled, matrices, weights, spans, polynomials, positions, velocities,
):  # fmt: skip
    """One slip from ``begin``, at a speed of ``creep``, where the force is ``surplus`` beyond what holds.

    ``drag`` goes with the square of the velocity. ``filled``, ``matrices`` and ``weights`` are of steps halved so many
    times, the first of the steps until one lag after breakaway.

    Fills the nodes that it passes. After the last one the force goes on as between the last two.

    Returns the time of its arrest, infinite if it goes on, where that is, Ψ then, the last node before it, and how many
    steps it took.
    """
    points, columns, halvings = weights.shape[1], matrices.shape[2], matrices.shape[0] - 2
    vector, forces, shapes, dragged = np.empty(_COLUMNS), np.empty(_POINTS), np.empty(_POINTS), np.zeros(_POINTS)
    values, unscaled = np.empty(_POINTS), np.ones(_POINTS)
    unit, lag = plant[STRIBECK_VELOCITY], plant[LAG]
    before_fall = math.ceil(lag / steps[_COARSE] - _NO_STEP)
    way, speed = 0.0, creep
    acceleration = (surplus - (plant[VISCOUS] + drag * creep) * creep) / plant[INERTIA]
    cursor, past = node, 0
    index, elapsed = 0, 0.0
    longest = _LONGEST * (times[last] - begin)
    while elapsed < longest and index < spans.shape[0] and abs(way) < _ABSURD:
        if index < before_fall:
            size, which = lag / before_fall, 0
        else:
            past = _step_at(elapsed - lag, past, index, spans)
            ratio = max(_velocity(elapsed - lag, past, spans, polynomials), 0.0) if index > 0 else 0.0
            size, which = steps[_COARSE], 1
            while which <= halvings and size > steps[_FINE] + steps[_GROWTH] * ratio:
                size *= 0.5
                which += 1
        matrix = matrices[which]
        if not filled[which]:
            filled[which] = True
            inertia = plant[INERTIA]
            spring, damping = stiffness * size * size / inertia, plant[VISCOUS] * size / inertia
            fill_step(1.0, spring, damping, _LATER, unscaled, _IN_FACTORIALS, matrix)
            _fill_lagged_weights(lag / size, weights[which])
        start = begin + elapsed
        mobility = size * size / plant[INERTIA]
        implicit = points
        for j in range(1, points):
            time = start + _NODES[j] * size
            while cursor + 1 < last and times[cursor + 1] < time:
                cursor += 1
            forces[j] = surplus + direction * _at(time, cursor, times, drives) - drive
            before = elapsed + _NODES[j] * size - lag
            if before <= 0.0 or index < before_fall:
                lagged = 0.0  # it had not begun
            elif _NODES[j] * size >= lag:
                implicit = min(implicit, j)
                lagged = (speed + acceleration * (_NODES[j] * size - lag)) / unit
            else:
                past = _step_at(before, past, index, spans)
                lagged = _velocity(before, past, spans, polynomials)
            shapes[j] = _stribeck_friction(law, 1.0, lagged)
            if drag != 0.0:
                # To begin with, as fast as it would be with the acceleration of the step's beginning.
                dragged[j] = drag * (speed + acceleration * _NODES[j] * size) ** 2
            vector[2 + j] = mobility * (forces[j] + level * (1.0 - shapes[j]) - dragged[j])
        values[0] = speed / unit
        vector[0], vector[1], vector[2] = way, speed * size, acceleration * size * size
        vector[2] += (stiffness * way + plant[VISCOUS] * speed) * mobility
        for _ in range(_MOST_SWEEPS):
            for i in range(points - 1):
                total = 0.0
                for j in range(columns):
                    total += matrix[i, j] * vector[j]
                values[i + 1] = total / (size * unit)
            change = 0.0
            for j in range(implicit, points):
                shape = _stribeck_friction(law, 1.0, _weighted(values, weights[which], j))
                if abs(shape - shapes[j]) > change:
                    change = abs(shape - shapes[j])
                shapes[j] = shape
            if drag != 0.0:
                for j in range(1, points):
                    now = drag * (values[j] * unit) ** 2
                    if abs(now - dragged[j]) > change * level:
                        change = abs(now - dragged[j]) / level
                    dragged[j] = now
            if change > 0.0:
                for j in range(1, points):
                    vector[2 + j] = mobility * (forces[j] + level * (1.0 - shapes[j]) - dragged[j])
            if change < _SETTLED:
                break
        spans[index, 0], spans[index, 1] = elapsed, size
        fill_polynomial(values, _LAGRANGE, polynomials[index])
        end = 0.0
        for j in range(columns):
            end += matrix[_END_POSITION, j] * vector[j]
        end_speed = values[_POINTS - 1] * unit
        force = forces[_POINTS - 1] + level * (1.0 - shapes[_POINTS - 1])
        resistance = (plant[VISCOUS] + drag * end_speed) * end_speed
        end_acceleration = (force - stiffness * end - resistance) / plant[INERTIA]
        arrest = math.inf
        for j in range(1, points):
            if values[j] <= 0.0:
                arrest = _first_not_positive(values, polynomials[index], j)
                break
        # Coefficients of the polynomial of degree five through position, velocity and acceleration at both ends.
        one, two = speed * size, 0.5 * acceleration * size * size
        rise = end - way - one - two
        slope = end_speed * size - one - 2.0 * two
        bend = end_acceleration * size * size - 2.0 * two
        three = 10.0 * rise - 4.0 * slope + 0.5 * bend
        four = -15.0 * rise + 7.0 * slope - bend
        five = 6.0 * rise - 3.0 * slope + 0.5 * bend
        until = start + (arrest if arrest < 1.0 else 1.0) * size
        per_size, signed = 1.0 / size, direction / size
        while node < last and times[node + 1] <= until:
            node += 1
            s = (times[node] - start) * per_size
            positions[node] = rest + direction * (way + s * (one + s * (two + s * (three + s * (four + s * five)))))
            pace = one + s * (2.0 * two + s * (3.0 * three + s * (4.0 * four + s * 5.0 * five)))
            velocities[node] = signed * pace
        if arrest <= 1.0:
            s = arrest
            way += s * (one + s * (two + s * (three + s * (four + s * five))))
            before = elapsed + arrest * size - lag
            if before <= 0.0:
                return until, way, 1.0, node, index + 1
            past = _step_at(before, past, index + 1, spans)
            shape = _stribeck_friction(law, 1.0, _velocity(before, past, spans, polynomials))
            return until, way, shape, node, index + 1
        way, speed, acceleration = end, end_speed, end_acceleration
        elapsed += size
        index += 1
    for i in range(node + 1, last + 1):
        # Nothing that moves so: what it came from was absurd, or not a number.
        positions[i] = velocities[i] = math.nan
    return math.inf, way, 1.0, last, index


@helper()
def _fill_steps(plant, gains, usual, sampled, steps):
    """Steps of the simulation [s], smooth in the parameters, with stiffness and damping of each slip's gains."""
    stiffness, damping = gains[0, 0], gains[0, 1]
    for n in range(1, gains.shape[0]):
        stiffness, damping = max(stiffness, gains[n, 0]), max(damping, gains[n, 1])
    inertia, duration = plant[INERTIA], usual[USUAL_DURATION]
    frequency = math.sqrt(stiffness / inertia) if stiffness > 0.0 else 2.0 * math.pi / duration
    most_rate = _MOST_RATE / usual[LONGEST_DURATION]
    rate = max(frequency / _OF_RADIAN, (plant[VISCOUS] + damping) / inertia / _OF_DECAY)
    coarse = 1.0 / min(max(rate, _LEAST_RATE / duration), most_rate)
    growth = _OF_CHANGE * plant[STRIBECK_VELOCITY] * _SPEEDING_UP * duration / usual[USUAL_SPEED]
    fine = max(growth + _OF_CHANGE * _OF_LAG * plant[LAG], 1.0 / most_rate)
    # A sampled force has a bend at every sample. Steps of one length keep the error by them smooth.
    steps[_COARSE], steps[_FINE] = min(coarse, fine) if sampled else coarse, fine
    steps[_GROWTH] = 0.0 if sampled else growth


@compiled(nogil=True)
def simulate_windows(
    parameters, law, directions, starts, surpluses, gains, drags, contacts, standing, edges, times, drives, usual,
    sampled, positions, velocities, found,
):  # fmt: skip
    """Simulate slip n from its start over the nodes ``edges[n]`` to ``edges[n + 1]``, by a law of ``_friction_law``.

    All but ``directions``, ``surpluses``, ``edges`` and ``times`` have as many rows as there are variants; gains,
    drags, contacts, standing and drives may have one for all. ``drags`` are of the square of the velocity, beside
    viscous friction. ``surpluses`` are by what the force exceeds what holds
    the joint when it breaks away, ``drives`` what the force on a joint at zero would be, without its velocity's part,
    ``standing`` its mean where the joint was seen to rest. What holds the joint at its breakaway beside the Stribeck
    friction is its kinetic friction, with any load, during the slip. It may stop and go on within the window, but does
    not turn.

    ``contacts`` are compliance and damping of the contact while the joint stands: it creeps with the force, and goes on
    from the speed of that when it breaks away, without the damping; when it stops it springs back, by what friction has
    been more than the force.

    ``usual`` is of the slips together; ``sampled`` is whether the force is one of samples.

    Returns the number of steps.
    """
    total = 0
    room = 0.0
    steps = np.empty((parameters.shape[0], _GROWTH + 1))
    for variant in range(parameters.shape[0]):
        _fill_steps(parameters[variant], gains[variant % gains.shape[0]], usual, sampled, steps[variant])
        smallest = steps[variant, _COARSE]
        for _ in range(_HALVINGS):
            if smallest > steps[variant, _FINE]:
                smallest *= 0.5
        for n in range(directions.shape[0]):
            needed = _LONGEST * (times[edges[n + 1] - 1] - starts[variant, n, BREAKAWAY]) / smallest
            if room < needed < _MOST_STEPS:
                room = needed
    spans, polynomials = np.empty((int(room) + 3, 2)), np.empty((int(room) + 3, _POINTS))
    # Of the steps until one lag after breakaway, then of those halved so many times.
    filled = np.zeros(_HALVINGS + 2, dtype=np.bool_)
    matrices, weights = np.empty((_HALVINGS + 2, _ROWS, _COLUMNS)), np.empty((_HALVINGS + 2, _POINTS, _POINTS))
    plant = np.empty(RISE_TIME + 1)
    for variant in range(parameters.shape[0]):
        for i in range(RISE_TIME + 1):
            plant[i] = parameters[variant, i]
        drive_at = drives[variant % drives.shape[0]]
        positions_at, velocities_at = positions[variant], velocities[variant]
        filled_stiffness = filled_damping = -1.0
        for n in range(directions.shape[0]):
            first, last = edges[n], edges[n + 1] - 1
            direction = directions[n]
            rest, begin, level = starts[variant, n, POSITION], starts[variant, n, BREAKAWAY], starts[variant, n, LEVEL]
            stiffness = gains[variant % gains.shape[0], n, 0]
            damping = gains[variant % gains.shape[0], n, 1]
            drag = drags[variant % drags.shape[0], n]
            plant[VISCOUS] = parameters[variant, VISCOUS] + damping
            if stiffness != filled_stiffness or damping != filled_damping:
                filled[:] = False
                filled_stiffness, filled_damping = stiffness, damping
            node = first
            while node + 2 <= last and times[node + 1] <= begin:
                node += 1
            drive = direction * _at(begin, node, times, drive_at)
            # As the joint creeps the controller's spring gives way: it creeps by less than the compliance alone.
            compliance = contacts[variant % contacts.shape[0], n, COMPLIANCE]
            softness = compliance / (1.0 + compliance * stiffness)
            creep = 0.0
            if softness > 0.0:
                rest += softness * (direction * drive - standing[variant % standing.shape[0], n])
                if begin > times[first]:
                    creep = max(softness * (drive - direction * drive_at[first]) / (begin - times[first]), 0.0)
            damped = creep * contacts[variant % contacts.shape[0], n, DAMPING]
            held = drive - direction * stiffness * rest - damped
            kinetic = held - level
            found[variant, n, HOLDING_FORCE] = held
            found[variant, n, ARREST] = math.nan
            found[variant, n, WENT_ON] = 0.0
            for i in range(first, node + 1):
                positions_at[i], velocities_at[i] = rest + softness * (drive_at[i] - direction * drive), 0.0
            level_now, surplus = level, surpluses[n] + damped
            for _ in range(_MOST_SLIPS):
                arrest, way, shape, node, taken = _slide(
                    begin, surplus, creep, level_now, drive, stiffness, drag, law, plant, steps[variant], direction,
                    rest, node, last, times, drive_at, filled, matrices, weights, spans, polynomials, positions_at,
                    velocities_at,
                )  # fmt: skip
                total += taken
                if math.isinf(arrest):
                    break
                rest += direction * way
                level_now *= shape
                found[variant, n, ARREST], found[variant, n, ARREST_POSITION] = arrest, rest
                found[variant, n, STRIBECK_FRACTION] = level_now / level
                if node == last:
                    break
                before, stopped = node, direction * _at(arrest, node, times, drive_at)
                holding = kinetic + direction * stiffness * rest
                rest -= direction * softness * (holding + level_now - stopped)
                holding = kinetic + direction * stiffness * rest
                begin, node = _next_breakaway(
                    arrest, holding, level_now, plant[STRIBECK], plant[RISE_TIME], direction, node, last, times,
                    drive_at,
                )  # fmt: skip
                for i in range(before + 1, (last if math.isinf(begin) else node) + 1):
                    positions_at[i], velocities_at[i] = rest + softness * (drive_at[i] - direction * stopped), 0.0
                if math.isinf(begin):
                    break
                found[variant, n, WENT_ON] += 1.0
                level_now = _risen_level(level_now, plant[STRIBECK], begin - arrest, plant[RISE_TIME])
                drive = direction * _at(begin, node, times, drive_at)
                surplus = drive - holding - level_now
            else:
                for i in range(node + 1, last + 1):
                    positions_at[i], velocities_at[i] = rest, 0.0
            if math.isnan(found[variant, n, ARREST]):
                ratio = velocities_at[last] / plant[STRIBECK_VELOCITY]
                found[variant, n, ARREST_POSITION] = positions_at[last]
                found[variant, n, STRIBECK_FRACTION] = _stribeck_friction(law, 1.0, ratio)
    return total
