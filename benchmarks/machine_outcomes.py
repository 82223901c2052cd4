# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is learnt from the recording of a machine off the paper's law, and how it compares with the truth."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.advice.recommendation import Advice, Kind
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.friction.estimate import NAMES, FrictionEstimate, ParameterEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.selected_model import select_model
from stickslip_ros.monitoring.uncertainty import stick_slip_probability

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from machines import ARREST_TIME, LUGRE, Machine, sticks
from random_machines import CONDITIONS, DURATION, MachineRecording, random_recording

ALL_NAMES = (*NAMES, "load")

_SURE = 0.05  # probability of being wrong
_NEAR = (0.9, 1.1)  # of the damping: what changes between them is too near the boundary to ask
_INTERVAL = 1.96  # standard errors
_SHARPEST = 1e-4  # standard error of a logarithm in a score, 1: at least


@dataclass(frozen=True, kw_only=True)
class Point:
    """A verdict at other gains or another speed: whether the machine sticks, and how probable the estimate has it."""

    name: str
    sticks: bool
    probability: float  # NaN without an estimate
    usable: bool

    @property
    def sure(self) -> bool:
        """Whether the estimate commits itself."""
        return self.usable and not _SURE < self.probability < 1.0 - _SURE

    @property
    def right(self) -> bool:
        """Whether the likelier verdict is the true one."""
        return not math.isnan(self.probability) and (self.probability > 0.5) == self.sticks


@dataclass(frozen=True, kw_only=True)
class Found:
    """One joint's outcome.

    Attributes
    ----------
    truth : of the parameters that have one. untrue : names that have none, and must not be called identified.
    estimate : None if there is none.
    cured : whether the machine no longer sticks with the least change of gains that is advised; None without advice.
    """

    condition: str
    seed: int
    slips: int
    truth: dict[str, float]
    untrue: tuple[str, ...]
    estimate: FrictionEstimate | None
    points: tuple[Point, ...]
    cured: bool | None
    seconds: float

    @property
    def usable(self) -> bool:
        """Whether there is an estimate to believe."""
        return self.estimate is not None and self.estimate.usable

    def identified(self, name: str) -> bool:
        """Whether a parameter is called identified."""
        return self.estimate is not None and parameter_of(self.estimate, name).identified

    def deviation(self, name: str) -> float:
        """Error of a parameter with a truth and an estimate in its standard errors, not negative."""
        assert self.estimate is not None
        one = parameter_of(self.estimate, name)
        return abs(one.value - self.truth[name]) / one.std if one.std > 0 else 0.0

    def log_score(self, name: str) -> float:
        """Logarithm of the density that the estimate has for the logarithm of a true value > 0."""
        assert self.estimate is not None
        one, truth = parameter_of(self.estimate, name), self.truth[name]
        spread = max(math.log1p(one.std / one.value), _SHARPEST)
        return -0.5 * (math.log(one.value / truth) / spread) ** 2 - math.log(spread * math.sqrt(2.0 * math.pi))

    def error(self, name: str) -> float:
        """Relative error of a parameter with a truth and an estimate, signed."""
        assert self.estimate is not None
        return (parameter_of(self.estimate, name).value - self.truth[name]) / abs(self.truth[name])

    def holds(self, name: str) -> bool:
        """Whether the 95 % interval of an identified parameter holds the truth."""
        assert self.estimate is not None
        if name in self.untrue:
            return False
        one = parameter_of(self.estimate, name)
        return bool(abs(one.value - self.truth[name]) < _INTERVAL * one.std)


def parameter_of(estimate: FrictionEstimate, name: str) -> ParameterEstimate:
    """A parameter by its name, or the load."""
    return estimate.load if name == "load" else estimate[name]


def run(condition: str, seed: int) -> Found:
    """Draw a recording, learn from it, ask for verdicts, and try the advice."""
    recording = random_recording(seed, CONDITIONS[condition])
    begin = time.perf_counter()
    assessment = assessed(recording)
    seconds = time.perf_counter() - begin
    estimate = assessment.estimate
    truth, untrue = truth_of(recording, DURATION)
    return Found(
        condition=condition,
        seed=seed,
        slips=len(recording.slips),
        truth=truth,
        untrue=untrue,
        estimate=estimate,
        points=points(recording, estimate),
        cured=_cured(recording, assessment.advice),
        seconds=seconds,
    )


def assessed(recording: MachineRecording, share: float = 1.0) -> Assessment:
    """What a monitor makes of the first part of a recording, as the analysis of bags has it."""
    monitor = JointMonitor(None, recording.gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(recording.batch.where(slice(0, round(share * len(recording.batch)))))
    monitor.finish()
    return monitor.assessment()


def _cured(recording: MachineRecording, advice: Advice | None) -> bool | None:
    if advice is None or math.isnan((least := advice.recommendation[Kind.LEAST_CHANGE]).stiffness):
        return None
    return not _sticks(recording, least.gains, advice.recommendation.velocity)


def _latest(recording: MachineRecording) -> Machine:
    """The machine as it is at the end of the recording, in the direction in which there is more friction."""
    return recording.machine.after(DURATION).in_the_worse_direction


def _sticks(recording: MachineRecording, gains: Gains, velocity: float) -> bool:
    """Whether that machine sticks with these gains at a speed [rad/s]."""
    period = recording.period if recording.machine.sampled else None
    return sticks(_latest(recording), gains, velocity, controller_period=period)


def truth_of(recording: MachineRecording, end: float) -> tuple[dict[str, float], tuple[str, ...]]:
    """The parameters at the last slip that ended by a time [s], and the names of those that it cannot show."""
    ended = recording.slips[recording.slips[:, ARREST_TIME] <= end, ARREST_TIME]
    machine = recording.machine.after(float(ended.max(initial=0.0))).in_the_worse_direction
    truth = {name: float(getattr(machine, name)) for name in NAMES}
    if machine.drag != 0.0:
        # Within a slip it is told with viscous friction.
        del truth["viscous"]
    if machine.law == LUGRE:
        del truth["lag"], truth["rise_time"]
    untrue: tuple[str, ...] = ()
    if machine.sampled:
        # Viscous friction is told with what the delay of the controller's force takes away.
        truth["viscous"] -= float(recording.gains.stiffness) * recording.delay
        if truth["viscous"] <= 0.0:
            del truth["viscous"]
            untrue = ("viscous",)
    if recording.one_way and machine.load != 0.0:
        del truth["coulomb"]
        untrue = (*untrue, "coulomb")
    load = machine.load + machine.asymmetry * machine.coulomb
    if not recording.one_way and load != 0.0:
        truth["load"] = load
    return truth, untrue


def points(recording: MachineRecording, estimate: FrictionEstimate | None) -> tuple[Point, ...]:
    """Verdicts around the present gains and the first speed, but for those next to the boundary."""
    machine = _latest(recording)
    gains, speed = recording.gains, recording.speeds[0]
    total = float(gains.damping) + machine.viscous

    def damped(share: float) -> Gains:
        return replace(gains, damping=share * total - machine.viscous)

    asked = {
        "speed / 2": (gains, 0.5 * speed),
        "speed * 2": (gains, 2.0 * speed),
        "damping / 2": (damped(0.5), speed),
        "damping * 1.5": (damped(1.5), speed),
        "stiffness * 2": (replace(gains, stiffness=2.0 * float(gains.stiffness)), speed),
    }
    found = []
    for name, (tried, velocity) in asked.items():
        its_total = float(tried.damping) + machine.viscous
        around = [replace(tried, damping=share * its_total - machine.viscous) for share in (1.0, *_NEAR)]
        verdicts = {_sticks(recording, one, velocity) for one in around}
        if len(verdicts) > 1:
            continue
        probability = math.nan
        selected, _ = select_model(estimate, None, recording.gains)
        if selected is not None and selected.uncertainty is not None:
            probability = stick_slip_probability(selected.uncertainty, tried, velocity)
        usable = estimate is not None and estimate.usable
        found.append(Point(name=name, sticks=verdicts.pop(), probability=probability, usable=usable))
    return tuple(found)
