# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled residuals, slopes and Gauss-Newton equations of many slips; :mod:`.slip_fit` is their face.

Each of these would be some dozens of numpy's functions on short arrays, whose calls take longer than the work.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import helper
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.model import _friction_law
from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction._window_kernel import (
    ARREST,
    BREAKAWAY,
    HOLDING_FORCE,
    LEVEL,
    POSITION,
    RISE_TIME,
    STRIBECK,
    STRIBECK_FRACTION,
)

UNKNOWNS = LEVEL + 1  # of a slip, the columns of its start
# Columns of what is known of a slip, as it was detected: where it rested, with the error, since when, its breakaway and
# duration, the dwell before, the end of its window, its direction; then by how much the tolerances divide the balance
# of forces and the level, and whether it goes on from the slip before.
(
    REST, REST_ERROR, REST_BEGIN, DETECTED, DURATION, DWELL, WINDOW_END, DIRECTION, BALANCE_WEIGHT, LEVEL_ERROR, LINKED
) = range(11)  # fmt: skip
# Columns of what Eq. (6) says of a level: its logarithm, and the slopes of that by the logarithms of F_s∞ and γ, the
# dwell and the logarithm of what remained of the level before.
EXPECTED, BY_STRIBECK, BY_RISE_TIME, BY_DWELL, BY_FRACTION = range(5)
TIES = BY_FRACTION + 1

HUBER = 3.0  # residual, standard deviations: a larger one counts linearly
WEAK = 1e-4  # weight of the detected breakaway, of that of the data
LARGEST_RESIDUAL = 1e150  # residual, standard deviations: any larger one is as bad, and its square is still finite
_NOTHING_LEFT = 1e-12  # Stribeck friction that is left, of the level
_LEAST_DWELL = 1e-3  # dwell, of the detected one
_LEAST, _LEAST_KINETIC = 1e-14, 1e-12  # addition to the diagonal of normal equations, of their trace
_REWEIGHTINGS, _SMALL = 10, 1e-3  # of the kinetic friction; misfit by which no weight grows any more, of the median

# Helpers, for what is inlined at many places takes numba long to go through.
_risen_level = helper()(_friction_law.risen_level)
_rising_rate = helper()(_friction_law.rising_rate)


@helper()
def _robust(residual):
    """Square, linear beyond the Huber limit."""
    size = abs(residual)
    if size > LARGEST_RESIDUAL:
        size = LARGEST_RESIDUAL
    return size * size if size < HUBER else 2.0 * HUBER * size - HUBER * HUBER


@helper()
def _weight(residual):
    """Weight that makes the square of a residual a robust one."""
    size = abs(residual)
    return 1.0 if size <= HUBER else HUBER / size


@helper()
def _solve_band(band, right):
    """Solve, in place, equations of whose positive definite matrix ``band`` has the lower diagonals, (width, n).

    ``right`` of shape (n, k) becomes the solutions, ``band`` the root. False if the matrix is not positive definite.
    """
    width, size = band.shape
    for i in range(size):
        for back in range(min(i, width - 1), -1, -1):
            j = i - back
            total = band[back, j]
            for k in range(max(0, i - width + 1), j):
                total -= band[i - k, k] * band[j - k, k]
            if back > 0:
                band[back, j] = total / band[0, j]
            elif total > 0.0 and total < np.inf:
                band[0, i] = math.sqrt(total)
            else:
                return False
    for i in range(size):
        for back in range(1, min(i, width - 1) + 1):
            for c in range(right.shape[1]):
                right[i, c] -= band[back, i - back] * right[i - back, c]
        for c in range(right.shape[1]):
            right[i, c] /= band[0, i]
    for i in range(size - 1, -1, -1):
        for ahead in range(1, min(size - 1 - i, width - 1) + 1):
            for c in range(right.shape[1]):
                right[i, c] -= band[ahead, i] * right[i + ahead, c]
        for c in range(right.shape[1]):
            right[i, c] /= band[0, i]
    return True


@helper()
def _solve(matrix, right):
    """Solve, in place, equations of a full matrix, by elimination with pivots; False if it is singular.

    In long valleys a matrix is positive definite but for its rounding.
    """
    size = len(right)
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if not 0.0 < abs(matrix[pivot, k]) < np.inf:
            return False
        for j in range(k, size):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, size):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return True


@compiled(nogil=True)
def measure(
    parameters, unknowns, kinetic, positions, found, before, slips, balance, targets, scale, observed, residuals,
    misfits, links, ties,
):  # fmt: skip
    """Fill the residuals of observations, balance of forces and levels, and ``ties``; returns their robust sum.

    ``before`` has arrest and share of F_s∞ left of the slip before the first. A slip that does not end is
    taken to end with its window, in ``found``. The sum has the detected rests and breakaways too, but no prior.
    """
    cost = 0.0
    for m in range(observed.shape[0]):
        residuals[m] = (targets[m] - positions[observed[m]]) * scale[m]
        cost += _robust(residuals[m])
    stribeck, rise_time = math.exp(parameters[STRIBECK]), math.exp(parameters[RISE_TIME])
    arrest, left, log_stribeck = before[0], before[1] * stribeck, math.log(stribeck)
    for n in range(slips.shape[0]):
        level = math.exp(unknowns[n, LEVEL])
        if not math.isfinite(found[n, ARREST]):
            found[n, ARREST] = slips[n, WINDOW_END]
        linked = slips[n, LINKED] > 0.0
        dwell = unknowns[n, BREAKAWAY] - (arrest if linked else slips[n, REST_BEGIN])
        if dwell < _LEAST_DWELL * slips[n, DWELL]:
            dwell = _LEAST_DWELL * slips[n, DWELL]
        share, steepness = _risen_level(0.0, 1.0, dwell, rise_time), _rising_rate(dwell, rise_time)
        if linked:
            risen = left + (stribeck - left) * share
            ties[n, EXPECTED] = math.log(risen)
            # What is left before the first slip is known as a share.
            ties[n, BY_STRIBECK] = stribeck * share / risen if n > 0 else 1.0
            ties[n, BY_RISE_TIME] = -(stribeck - left) / risen * dwell * steepness
            ties[n, BY_DWELL] = (stribeck - left) / risen * steepness
            ties[n, BY_FRACTION] = left * (1.0 - share) / risen
        else:
            # What was left is anything from none to all: in the middle of the two.
            ties[n, EXPECTED] = log_stribeck + 0.5 * math.log(share)
            ties[n, BY_STRIBECK] = 1.0
            ties[n, BY_RISE_TIME] = -0.5 * (1.0 - share)
            ties[n, BY_DWELL] = 0.5 * steepness / share
            ties[n, BY_FRACTION] = 0.0
        arrest, left = found[n, ARREST], level * found[n, STRIBECK_FRACTION]
        misfit = found[n, HOLDING_FORCE] - level
        for k in range(kinetic.shape[0]):
            misfit -= balance[n, k] * kinetic[k]
        misfits[n] = misfit * slips[n, BALANCE_WEIGHT]
        links[n] = (unknowns[n, LEVEL] - ties[n, EXPECTED]) / slips[n, LEVEL_ERROR]
        rest = (unknowns[n, POSITION] - slips[n, REST]) / slips[n, REST_ERROR]
        drift = (unknowns[n, BREAKAWAY] - slips[n, DETECTED]) / slips[n, DURATION]
        cost += _robust(misfits[n]) + _robust(links[n]) + rest * rest + WEAK * drift * drift
    return cost


@compiled(nogil=True)
def fill_slopes(
    positions, found, steps, moving, active, unknowns, stiffness, slips, balance, targets, scale, observed, edges,
    residuals, found_here, ties, terms, by_shared, by_own,
):  # fmt: skip
    """Slopes of all residuals, by differences to variants that are ``steps`` off in one parameter or unknown each.

    The variants are of the ``moving`` parameters, then of breakaways, then of levels. Rows of ``terms``: slopes of the
    observations by the moving parameters and by their slip's own unknowns; residuals. Of balance and link of each slip
    ``by_shared`` has slopes by parameters and kinetic friction, of shape (2, slips, columns), and ``by_own`` by its own
    unknowns, and in its third row those of the link that follows, (3, slips, unknowns). ``active`` tells of each
    parameter whether it is free; slopes by others are zero.
    """
    variants, count, shared = positions.shape[0], slips.shape[0], moving.shape[0]
    for n in range(count):
        for v in range(variants):
            row = v if v < shared else v + 1
            step = steps[v, n]
            for m in range(edges[n], edges[n + 1]):
                terms[row, m] = ((targets[m] - positions[v, observed[m]]) * scale[m] - residuals[m]) / step
            force = (found[v, n, HOLDING_FORCE] - found_here[n, HOLDING_FORCE]) / step * slips[n, BALANCE_WEIGHT]
            link = 0.0
            if n + 1 < count and slips[n + 1, LINKED] > 0.0:
                # Where the joint stops without a trace of Stribeck friction nothing is left to the next slip.
                left, left_here = found[v, n, STRIBECK_FRACTION], found_here[n, STRIBECK_FRACTION]
                left = left if left > _NOTHING_LEFT else _NOTHING_LEFT
                left_here = left_here if left_here > _NOTHING_LEFT else _NOTHING_LEFT
                ended = found[v, n, ARREST]
                ended = (ended if math.isfinite(ended) else slips[n, WINDOW_END]) - found_here[n, ARREST]
                link = ties[n + 1, BY_DWELL] * ended - ties[n + 1, BY_FRACTION] * math.log(left / left_here)
                link /= step * slips[n + 1, LEVEL_ERROR]
            if v < shared:
                by_shared[0, n, moving[v]] = force
                if n + 1 < count:
                    by_shared[1, n + 1, moving[v]] = link
            else:
                by_own[0, n, BREAKAWAY + v - shared], by_own[2, n, BREAKAWAY + v - shared] = force, link
        for m in range(edges[n], edges[n + 1]):
            # A slip that begins elsewhere is the same slip there.
            terms[shared, m] = -scale[m]
            terms[variants + 1, m] = residuals[m]
        error = slips[n, LEVEL_ERROR]
        if active[STRIBECK]:
            by_shared[1, n, STRIBECK] -= ties[n, BY_STRIBECK] / error
        if active[RISE_TIME]:
            by_shared[1, n, RISE_TIME] -= ties[n, BY_RISE_TIME] / error
        for k in range(balance.shape[1]):
            by_shared[0, n, active.shape[0] + k] = -balance[n, k] * slips[n, BALANCE_WEIGHT]
        by_own[0, n, POSITION] = -slips[n, DIRECTION] * stiffness[n] * slips[n, BALANCE_WEIGHT]
        by_own[0, n, LEVEL] -= math.exp(unknowns[n, LEVEL]) * slips[n, BALANCE_WEIGHT]
        by_own[1, n, BREAKAWAY] = -ties[n, BY_DWELL] / error
        by_own[1, n, LEVEL] = 1.0 / error
        if n + 1 < count:
            by_own[2, n, LEVEL] -= ties[n + 1, BY_FRACTION] / slips[n + 1, LEVEL_ERROR]


@helper(fastmath={"reassoc"})  # sums in any order, so that several terms are added at once
def _products(terms, begin, end, weighted, products):
    """Sums of the weighted products of all rows over some columns; the last row has the residuals."""
    rows = terms.shape[0]
    for i in range(rows):
        for m in range(begin, end):
            weighted[m - begin] = _weight(terms[rows - 1, m]) * terms[i, m]
        for j in range(i + 1):
            total = 0.0
            for m in range(begin, end):
                total += weighted[m - begin] * terms[j, m]
            products[i, j] = products[j, i] = total


@compiled(nogil=True)
def collect(
    terms, edges, moving, by_shared, by_own, misfits, links, unknowns, slips, matrix, gradient, mixed, band, slope
):
    """Add up the normal equations from what :func:`fill_slopes` has filled; all that is filled here is zero before.

    ``matrix`` and ``gradient`` are those of parameters and kinetic friction, ``band`` has the lower diagonals of that
    of the slips' unknowns, ``slope`` their gradient, and ``mixed`` of shape (unknowns, columns) is what is between.
    """
    rows, count, shared, columns = terms.shape[0], slips.shape[0], moving.shape[0], matrix.shape[0]
    products, weighted = np.empty((rows, rows)), np.empty(terms.shape[1])
    for n in range(count):
        first = n * UNKNOWNS
        _products(terms, edges[n], edges[n + 1], weighted, products)
        for i in range(shared):
            gradient[moving[i]] -= products[rows - 1, i]
            for j in range(shared):
                matrix[moving[i], moving[j]] += products[i, j]
            for a in range(UNKNOWNS):
                mixed[first + a, moving[i]] += products[shared + a, i]
        for a in range(UNKNOWNS):
            slope[first + a] -= products[rows - 1, shared + a]
            for b in range(a + 1):
                band[a - b, first + b] += products[shared + a, shared + b]
        for which in range(2):
            residual = misfits[n] if which == 0 else links[n]
            weight = _weight(residual)
            for i in range(columns):
                weighted_slope = weight * by_shared[which, n, i]
                gradient[i] -= weighted_slope * residual
                for j in range(columns):
                    matrix[i, j] += weighted_slope * by_shared[which, n, j]
                for a in range(UNKNOWNS):
                    mixed[first + a, i] += weighted_slope * by_own[which, n, a]
                    if which == 1 and n > 0:
                        mixed[first - UNKNOWNS + a, i] += weighted_slope * by_own[2, n - 1, a]
            for a in range(UNKNOWNS):
                weighted_slope = weight * by_own[which, n, a]
                slope[first + a] -= weighted_slope * residual
                for b in range(a + 1):
                    band[a - b, first + b] += weighted_slope * by_own[which, n, b]
                if which == 1 and n > 0:
                    # The link joins the slip's unknowns with those of the slip before.
                    before = first - UNKNOWNS
                    for b in range(UNKNOWNS):
                        band[UNKNOWNS + a - b, before + b] += weighted_slope * by_own[2, n - 1, b]
                    weighted_slope = weight * by_own[2, n - 1, a]
                    slope[before + a] -= weighted_slope * residual
                    for b in range(a + 1):
                        band[a - b, before + b] += weighted_slope * by_own[2, n - 1, b]
        certainty = 1.0 / slips[n, REST_ERROR] ** 2
        band[0, first + POSITION] += certainty
        slope[first + POSITION] -= (unknowns[n, POSITION] - slips[n, REST]) * certainty
        certainty = WEAK / slips[n, DURATION] ** 2
        band[0, first + BREAKAWAY] += certainty
        slope[first + BREAKAWAY] -= (unknowns[n, BREAKAWAY] - slips[n, DETECTED]) * certainty


@compiled(nogil=True)
def eliminate(matrix, gradient, mixed, band, slope, damping):
    """Eliminate the slips' unknowns from the equations of :func:`collect`, the diagonal of their part damped.

    Returns whether that part is positive definite; the Schur complement and the gradient of parameters and kinetic
    friction; and the solutions for the unknowns of ``mixed`` and of ``slope``, in the columns of one array.
    """
    size, columns = mixed.shape
    root, solved = band.copy(), np.empty((size, columns + 1))
    root[0] *= 1.0 + damping
    solved[:, :columns] = mixed
    solved[:, columns] = slope
    reduced, left = matrix.copy(), gradient.copy()
    definite = _solve_band(root, solved)
    for m in range(size):
        for i in range(columns):
            # Unknowns of a slip have no part in many of the columns.
            if mixed[m, i] != 0.0:
                for j in range(columns):
                    reduced[i, j] -= mixed[m, i] * solved[m, j]
                left[i] -= mixed[m, i] * solved[m, columns]
    return definite, reduced, left, solved


@compiled(nogil=True)
def damped_step(
    matrix, gradient, mixed, band, slope, damping, information, pull, parameters, lower, upper, longest
):  # fmt: skip
    """Step of Levenberg and Marquardt by the equations of :func:`collect`, with a prior.

    ``information`` is the prior's, ``pull`` its gradient; no parameter changes by more than ``longest``. Parameters
    that would leave their bounds stay on them.

    Returns whether the equations are positive definite; the step of parameters and kinetic friction; and that of the
    slips' unknowns, shape (slips, 3).
    """
    definite, full, left, solved = eliminate(matrix, gradient, mixed, band, slope, damping)
    size, shared = len(left), len(parameters)
    step, own = np.zeros(size), np.empty((len(slope) // UNKNOWNS, UNKNOWNS))
    if not definite:
        return False, step, own
    for i in range(shared):
        left[i] += pull[i]
        for j in range(shared):
            full[i, j] += information[i, j]
    trace = np.trace(full)
    for i in range(size):
        full[i, i] += damping * full[i, i] + _LEAST * trace
    free = np.arange(size)
    while True:
        count = len(free)
        part, right = np.empty((count, count)), np.empty(count)
        for i in range(count):
            right[i] = left[free[i]]
            for j in range(count):
                part[i, j] = full[free[i], free[j]]
        if not _solve(part, right):
            return False, step, own
        step[:] = 0.0
        for i in range(count):
            step[free[i]] = right[i]
        stays = np.zeros(size, dtype=np.bool_)
        for k in range(shared):
            stays[k] = (parameters[k] <= lower[k] and step[k] < 0.0) or (parameters[k] >= upper[k] and step[k] > 0.0)
        if not stays.any():
            break
        free = free[~stays[free]]
    most = 0.0
    for k in range(shared):
        most = max(most, abs(step[k]))
    if most > longest:
        step *= longest / most
    for n in range(own.shape[0]):
        for a in range(UNKNOWNS):
            own[n, a] = solved[n * UNKNOWNS + a, size]
            for i in range(size):
                own[n, a] -= solved[n * UNKNOWNS + a, i] * step[i]
    return True, step, own


@compiled(nogil=True)
def fill_kinetic(balance, usable, target, kinetic):
    """Fill the kinetic friction that balances most of the forces ``target``, shape (slips,).

    Least absolute deviations by reweighting, of the slips that are usable. False if they do not show it.
    """
    count, size = balance.shape
    weights, misfits = usable.astype(np.float64), np.empty(count)
    for _ in range(_REWEIGHTINGS):
        products = np.zeros((size, size))
        kinetic[:] = 0.0
        for n in range(count):
            for i in range(size):
                weighted = weights[n] * balance[n, i]
                kinetic[i] += weighted * target[n]
                for j in range(size):
                    products[i, j] += weighted * balance[n, j]
        # Of a speed at which no slip is usable nothing is known.
        trace = np.trace(products)
        for i in range(size):
            products[i, i] += _LEAST_KINETIC * trace
        if not _solve(products, kinetic):
            return False
        for n in range(count):
            misfit = target[n]
            for i in range(size):
                misfit -= balance[n, i] * kinetic[i]
            misfits[n] = abs(misfit)
        least = _SMALL * np.median(misfits) + TINY
        for n in range(count):
            weights[n] = usable[n] / max(misfits[n], least)
        weights /= weights.max()
    return True
