# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the samples show of one slip: the observations that a fit compares with a simulated slip.

An encoder says most at the instants at which its count changes: the joint then is within one sample's way
of the edge between two counts. All other samples repeat what these said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.regression import SIGNIFICANT_ERRORS
from stickslip_ros.monitoring.samples import ROUNDING_STD, Batch, FloatArray, effort_is_measured

_MOST_OBSERVATIONS = 240  # observations of a slip, 1: at most
_SHAPE_NODES = 40  # nodes for reference and effort beside those of the observations, 1
_BEFORE, _AFTER = 0.4, 0.12  # times before and after a slip in which it may begin and end, of the slip's duration
_OF_DWELL = 0.5  # time into a rest, of the rest: so far counts may still change by the slip
_SETTLED = (0.1, 0.6)  # times in a dwell between which the joint stands after the slip, of the dwell
_LEAVES = 0.9  # time in the rest after the slip, of the rest: the joint may begin to leave then
_CREEPS = 3.0  # creep of a joint that stands, counts or standard deviations of noise
_EARLY = 0.4  # early part of a rest, of what is seen of it
_LEAST_STANDING = 0.02  # time at rest, of the slip: a joint that stands for less creeps from its arrest on
_LEAST_OBSERVATIONS = 5  # observations of a slip or samples of a rest, 1: at least
_ANALOG = 0.5  # noise, of a resolution: with more the counts say nothing of their own
_FEWEST_PIECES, _MOST_PIECES = 4, 64  # pieces of the spline through the effort around a slip, 1
_EVEN = 0.02  # mean deviation of sample intervals, of their mean: stamps with less jitter count as even
_STEP = 0.4  # change of the reference's speed from sample to sample, of all its changes in a slip: more is a step
_LINE_REACH = 4  # samples on either side of a local line, 1
_SAME_STIFFNESS = 0.1  # difference of two stiffnesses, of the stiffness: with less they are one
_LEAST_SHOWN = 3  # slips whose effort may contradict the gains, 1: at least


class ForceSource(Enum):
    """Where the force on a joint is known from."""

    GAINS = "gains and reference"
    EFFORT = "effort"
    SPEED = "speed alone"


@dataclass(frozen=True, kw_only=True)
class Standing:
    """Where a joint stands, on average, before a slip or after it.

    Attributes
    ----------
    position : [rad]. drive : the controller's force on it if it stood at zero [N·m].
    """

    position: float
    drive: float


@dataclass(frozen=True, kw_only=True)
class SlipWindow:
    """One slip as the samples show it; arrays of nodes have shape (n,), of observations (m,).

    Attributes
    ----------
    direction : ±1. rest_begin, breakaway, arrest : as detected [s].
    rest_position, rest_error : where the joint rested before, and the standard deviation of that [rad].
    source : of the force. gains : in force then, None if unknown; stiffness and damping are zero if the source is the
        effort.
    times : of the nodes [s]; references : at the nodes [rad], zero if unknown; forces : beside the gains' [N·m].
    reference_speed : mean of the reference [rad/s], NaN if unknown.
    observed : indices of the nodes observed; values : position there [rad].
    gaps : time since the sample before [s]; NaN for a sample that is no change of count.
    resolution, noise : of the position [rad]. sample_interval : [s].
    arrived, before, after : where the joint stood early in the rest before the slip, towards the end of that, and after
        the slip; None if that is not known.
    effort_stiffness : k_p [N·m/rad] by which the effort follows the tracking error in the rest before, and its
        standard error; NaN if the effort or the gains are not known.
    """

    direction: int
    rest_begin: float
    breakaway: float
    arrest: float
    rest_position: float
    rest_error: float
    source: ForceSource
    gains: Gains | None
    times: FloatArray
    references: FloatArray
    forces: FloatArray
    reference_speed: float
    observed: np.ndarray
    values: FloatArray
    gaps: FloatArray
    resolution: float
    noise: float
    sample_interval: float
    arrived: Standing | None = None
    before: Standing | None = None
    after: Standing | None = None
    effort_stiffness: tuple[float, ...] = (math.nan, math.nan)

    @property
    def slip_distance(self) -> float:
        """As observed, signed [rad]."""
        return float(self.values[-1] - self.rest_position)

    @property
    def loading_rate(self) -> float:
        """How fast the force that is known beside the gains' changes before the slip [N·m/s]."""
        change = float(np.interp(self.breakaway, self.times, self.forces) - self.forces[0])
        return abs(change) / max(self.breakaway - float(self.times[0]), TINY)

    def without_force(self) -> SlipWindow:
        """The same slip as if neither effort nor gains were known."""
        return replace(self, source=ForceSource.SPEED, gains=None, forces=np.zeros_like(self.forces))

    def between_creep(self) -> SlipWindow:
        """The same slip with where the joint stood on average at either end, and nothing of how it sprang back."""
        if self.before is None or self.after is None:
            return self
        times = self.times[self.observed]
        # A count that goes the other way is one of how it springs back, or of an encoder that flickers.
        back = np.isfinite(self.gaps) & (self.direction * np.diff(self.values, prepend=self.rest_position) < 0.0)
        late = back & (times > 0.5 * (self.breakaway + self.arrest))
        kept = ~back & (times <= min(self.arrest, times[late].min(initial=math.inf)))
        kept[-1] = True
        return replace(
            self,
            rest_position=self.before.position,
            observed=self.observed[kept],
            values=np.append(self.values[kept][:-1], self.after.position),
            gaps=self.gaps[kept],
        )

    def thinned(self, most: int) -> SlipWindow:
        """The same slip with at most so many observations, evenly chosen, and no nodes for the others."""
        if len(self.observed) <= most:
            return self
        chosen = np.unique(np.round(np.linspace(0, len(self.observed) - 1, most)).astype(int))
        kept = np.ones(len(self.times), dtype=bool)
        kept[np.delete(self.observed, chosen)] = False
        kept[[0, -1]] = True
        return replace(
            self,
            times=self.times[kept],
            references=self.references[kept],
            forces=self.forces[kept],
            observed=(np.cumsum(kept) - 1)[self.observed[chosen]],
            values=self.values[chosen],
            gaps=self.gaps[chosen],
        )


def slip_window(
    samples: Batch, cycle: Cycle, gains: Gains | None, *, resolution: float, noise: float
) -> SlipWindow | None:
    """Cut one slip out of the samples; None if they show too little of it.

    Parameters
    ----------
    samples : of the joint, around the cycle. gains : in force during it, None if unknown.
    resolution, noise : of the position [rad].
    """
    if not cycle.dated:
        return None
    # What friction does as it yields is not known: a slip is fitted from where the joint stirs. One that creeps from
    # its arrest on stirs at no time of its own.
    duration = cycle.slip_duration
    creep = cycle.creep if cycle.dwell - cycle.creep > _LEAST_STANDING * duration else 0.0
    left, dwell = cycle.breakaway - creep, cycle.dwell - creep
    duration += creep
    begin = left - min(_BEFORE * duration, dwell)
    end = cycle.arrest + min(_AFTER * duration, dwell)
    first, last = np.searchsorted(samples.time, [begin, end], side="right")
    first = max(int(first) - 1, 0)
    if last - first < _LEAST_OBSERVATIONS or samples.time[first] > left:
        return None
    rest_from, rest_to = np.searchsorted(samples.time, [left - 0.6 * dwell, left - 0.03 * dwell])
    resting = slice(int(rest_from), max(int(rest_to), int(rest_from) + 1))
    seen_from = max(left - (1.0 - _SETTLED[0]) * dwell, float(samples.time[0]))
    arriving = slice(*np.searchsorted(samples.time, [seen_from, seen_from + _EARLY * (left - seen_from)]))
    # The next rest may be shorter than the one before this slip, which may have been a pause.
    settles = min(dwell, _LEAVES / _SETTLED[1] * cycle.stands)
    after_from, after_to = np.searchsorted(samples.time, [cycle.arrest + share * settles for share in _SETTLED])
    after = slice(min(int(after_from), len(samples) - 1), max(int(after_to), int(after_from) + 1))
    part = samples.where(slice(first, int(last)))
    analog = noise > _ANALOG * resolution
    changed = np.append(False, np.diff(part.position) != 0) if not analog else np.ones(len(part), bool)
    inside = part.time > left - _OF_DWELL * (left - begin)
    inside &= part.time <= cycle.arrest + _OF_DWELL * (end - cycle.arrest)
    indices = np.flatnonzero(changed & inside & (np.arange(len(part)) > 0))
    if len(indices) < _LEAST_OBSERVATIONS:
        return None
    if len(indices) > _MOST_OBSERVATIONS:
        indices = indices[np.round(np.linspace(0, len(indices) - 1, _MOST_OBSERVATIONS)).astype(int)]
    shape = np.round(np.linspace(0, len(part) - 1, min(_SHAPE_NODES, len(part)))).astype(int)
    stop = max(int(np.searchsorted(part.time, cycle.arrest + _OF_DWELL * (end - cycle.arrest))), int(indices[-1]) + 1)
    stop = min(stop, len(part) - 1)
    shown = _effort_stiffness(samples.where(resting))
    source, in_force, forces = _forces(samples, part, resting, gains, resolution, shown)
    known = np.isfinite(part.reference_position).all()
    references = _reference(part) if known else np.zeros(len(part))
    # Between nodes the reference is a line: where its speed changes at once, samples in a row are nodes.
    changes = np.abs(np.diff(references, 2))
    bend = int(np.argmax(changes)) + np.arange(3)
    if changes.max() > _STEP * changes.sum():
        # By how much the force then exceeds what held the joint is known no better than when the joint broke away.
        moved = float(part.time[indices][part.time[indices] > left].min(initial=cycle.arrest))
        if abs(part.time[bend[1]] - left) <= moved - left:
            return None
    nodes = np.unique(np.concatenate([indices, shape, bend, [stop]]))
    if np.isfinite(part.reference_velocity).all():
        speed = float(part.reference_velocity.mean())
    elif known:
        speed = float(part.reference_position[-1] - part.reference_position[0]) / float(part.time[-1] - part.time[0])
    else:
        speed = math.nan
    rest = samples.position[resting]
    spread = noise / math.sqrt(len(rest)) if analog else ROUNDING_STD * resolution
    gaps = part.time[indices] - part.time[indices - 1]
    stops = samples.position[after]
    reach = _CREEPS * max(resolution, noise)
    return SlipWindow(
        direction=1 if cycle.slip_distance > 0 else -1,
        rest_begin=left - dwell,
        breakaway=left,
        arrest=cycle.arrest,
        rest_position=float(np.median(rest)) if not analog else float(np.mean(rest)),
        rest_error=max(spread, 1e-3 * resolution),
        source=source,
        gains=in_force,
        times=part.time[nodes],
        references=references[nodes],
        forces=forces[nodes],
        reference_speed=speed,
        observed=np.searchsorted(nodes, np.append(indices, stop)),
        values=np.append(part.position[indices], np.median(stops) if not analog else np.mean(stops)),
        gaps=np.append(gaps if not analog else np.full(len(gaps), np.nan), np.nan),
        resolution=resolution if not analog else 0.0,
        noise=noise if analog else 0.0,
        sample_interval=float(np.median(np.diff(part.time))),
        arrived=standing(samples.where(arriving), reach, source, in_force, speed, forces),
        before=standing(samples.where(resting), reach, source, in_force, speed, forces),
        after=standing(samples.where(after), reach, source, in_force, speed, forces),
        effort_stiffness=shown if source is ForceSource.GAINS else (math.nan, math.nan),
    )


def standing(
    rest: Batch, reach: float, source: ForceSource, gains: Gains | None, speed: float, beside: FloatArray
) -> Standing | None:
    """Means over samples of a joint that stands; None where the force is not known.

    Parameters
    ----------
    reach : from the median, of what counts: the joint may have left by then [rad].
    speed : of the reference [rad/s]. beside : force beside the gains' during the slip [N·m].
    """
    if source is ForceSource.SPEED or gains is None or len(rest) == 0:
        return None
    rest = rest.where(np.abs(rest.position - np.median(rest.position)) <= reach)
    if len(rest) == 0:
        return None
    if source is ForceSource.EFFORT:
        drive = float(np.mean(rest.effort))
    else:
        drive = float(gains.stiffness) * float(np.mean(rest.reference_position)) + float(gains.damping) * speed
        drive += float(np.mean(beside))
    return Standing(position=float(np.mean(rest.position)), drive=drive) if math.isfinite(drive) else None


def _forces(
    samples: Batch,
    part: Batch,
    resting: slice,
    gains: Gains | None,
    resolution: float,
    shown: tuple[float, ...],
) -> tuple[ForceSource, Gains | None, FloatArray]:
    """Where the force comes from, the gains that count, and the force beside theirs at each sample.

    An effort that follows the reference by another stiffness than the gains' is not theirs, or not in their units.
    """
    effort_known = effort_is_measured(part.effort)
    reference_known = bool(np.isfinite(part.reference_position).all())
    none = np.zeros(len(part))
    if gains is not None and reference_known and gains.integral == 0:
        slope, error = shown
        allowed = _SAME_STIFFNESS * float(gains.stiffness) + SIGNIFICANT_ERRORS * error
        if effort_known and not abs(slope - float(gains.stiffness)) > allowed:
            none += _feed_forward(samples.where(resting), gains, resolution)
        return ForceSource.GAINS, gains, none
    if effort_known:
        in_force = replace(gains, stiffness=0.0, damping=0.0) if gains is not None else Gains(stiffness=0.0)
        return ForceSource.EFFORT, in_force, _without_noise(part.time, part.effort)
    return ForceSource.SPEED, gains, none


def _without_noise(times: FloatArray, values: FloatArray) -> FloatArray:
    """Samples on the cubic spline through them whose number of pieces makes generalised cross-validation least.

    With the noise of its samples a force leads a fit nowhere: what holds the joint at its breakaway would have a valley
    at every sample. Source: P. Craven, G. Wahba, "Smoothing noisy data with spline functions" (1979).
    """
    from scipy.interpolate import make_lsq_spline

    best, least, pieces = values, math.inf, _FEWEST_PIECES
    while pieces <= _MOST_PIECES and 2 * (pieces + 3) < len(times):
        # Each piece has as many samples.
        inner = times[np.round(np.linspace(0, len(times) - 1, pieces + 1)).astype(int)[1:-1]]
        spline = make_lsq_spline(times, values, np.concatenate([[times[0]] * 4, inner, [times[-1]] * 4]))
        smooth = spline(times)
        score = float(np.sum((values - smooth) ** 2)) / (len(times) - pieces - 3) ** 2
        if score < least:
            best, least = smooth, score
        pieces *= 2
    return best


def _reference(part: Batch) -> FloatArray:
    """The reference at the samples [rad], without the noise that jitter of the stamps adds.

    A reference is smooth and its samples are not; where the stamps are uneven a parabola replaces it, if what
    that leaves is no more than the stamps explain, else local lines.
    """
    times, reference = part.time, part.reference_position
    steps = np.diff(times)
    usual = float(np.median(steps))
    uneven = float(np.mean(np.abs(steps - usual)))
    if uneven < _EVEN * usual or len(times) < _LEAST_OBSERVATIONS:
        return reference
    middle = 0.5 * (times[0] + times[-1])
    coefficients = np.polynomial.polynomial.polyfit(times - middle, reference, 2)
    parabola = np.polynomial.polynomial.polyval(times - middle, coefficients)
    speed = abs(float(reference[-1] - reference[0])) / float(times[-1] - times[0])
    if float(np.sqrt(np.mean((reference - parabola) ** 2))) <= speed * uneven:
        return np.asarray(parabola)
    reach = _LINE_REACH
    smooth = np.empty_like(reference)
    for index in range(len(times)):
        near = slice(max(0, index - reach), index + reach + 1)
        line = np.polynomial.polynomial.polyfit(times[near] - times[index], reference[near], 1)
        smooth[index] = line[0]
    return smooth


def _effort_stiffness(rest: Batch) -> tuple[float, float]:
    """Slope of the effort over the tracking error while the joint rests, and its standard error [N·m/rad]; or NaN."""
    effort, error = rest.effort, rest.reference_position - rest.position
    if len(rest) < _LEAST_OBSERVATIONS or not effort_is_measured(effort):
        return math.nan, math.nan
    effort, error = effort - np.mean(effort), error - np.mean(error)
    power = float(error @ error)
    if not power > 0.0:
        return math.nan, math.nan
    slope = float(effort @ error) / power
    left = effort - slope * error
    return slope, math.sqrt(float(left @ left) / (len(rest) - 2) / power)


def stiffness_difference(windows: Sequence[SlipWindow]) -> tuple[float, float]:
    """Logarithm of the effort's stiffness at rest over the gains', and its standard error; zeros if none is shown."""
    shown = _shown_stiffnesses(windows)
    if len(shown) < max(_LEAST_SHOWN, 0.5 * len(windows)):
        return 0.0, 0.0
    ratios = np.log(shown[:, 0] / shown[:, 1])
    return float(np.median(ratios)), 1.25 * float(np.std(ratios)) / math.sqrt(len(ratios))


def contradiction(windows: Sequence[SlipWindow]) -> str:
    """What the effort says against the gains, "" if nothing: by another stiffness it follows the reference at rest."""
    ratio, error = stiffness_difference(windows)
    if abs(ratio) <= _SAME_STIFFNESS + SIGNIFICANT_ERRORS * error:
        return ""
    seen, given = np.median(_shown_stiffnesses(windows), axis=0).tolist()
    per_degree = abs(abs(ratio) - math.log(180.0 / math.pi)) < _SAME_STIFFNESS
    why = "per degree and per radian?" if per_degree else "other units, or other gains in force?"
    return f"the effort rises by {seen:.4g} N·m/rad with the reference, and the gains say {given:.4g} ({why})"


def _shown_stiffnesses(windows: Sequence[SlipWindow]) -> FloatArray:
    """Stiffness of the effort and of the gains, of each slip whose effort shows one [N·m/rad]; shape (n, 2)."""
    return np.array(
        [
            (one.effort_stiffness[0], float(one.gains.stiffness))
            for one in windows
            if one.gains is not None and one.effort_stiffness[0] > SIGNIFICANT_ERRORS * one.effort_stiffness[1]
        ]
    )


def _feed_forward(rest: Batch, gains: Gains, resolution: float) -> float:
    """What the effort at rest holds beside the gains' force, if it is more than the noise explains [N·m]."""
    if len(rest) < _LEAST_OBSERVATIONS:
        return 0.0
    speed = np.gradient(rest.reference_position, rest.time)
    law = float(gains.stiffness) * (rest.reference_position - rest.position) + float(gains.damping) * speed
    beside = rest.effort - law
    mean = float(np.median(beside))
    error = 1.25 * float(np.std(beside)) / math.sqrt(len(beside))
    # The controller may have seen the position finer than its count.
    error += float(gains.stiffness) * resolution / SIGNIFICANT_ERRORS
    return mean if abs(mean) > SIGNIFICANT_ERRORS * error else 0.0
