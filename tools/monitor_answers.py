# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction, advice and diagnostics of `python -m tools.answers`, each by its index."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import elastic_joints
import numpy as np
import random_advice
import random_joints
import random_machines
import varying_machines

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.long_motion import natural_period
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.advice.adviser import advise
from stickslip_ros.monitoring.advice.limits import Criterion, ObservedLoop
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, AdviceQuestion, Assessment, ExactQuestion, MonitorOptions
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES, FrictionEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.uncertainty import Uncertainty
from stickslip_ros.output.as_json import dry_friction_json, growth_json, recommendation_json
from stickslip_ros.output.diagnosis import Diagnosis, cycle_diagnostic, joint_diagnostic
from stickslip_ros.output.published import MARGIN_FIELDS, Findings, margin_row, numbers_or_null
from tools.model_answers import KNOWN, SEED, Answer, plain, with_contact
from tools.recording_answers import VARYING, two_speeds_recording, varying_recording

DRAWS = 32  # joints that stand for an uncertain one, as in the tests of the advice
DRAWN_STD = 0.1  # standard deviation of the logarithm of each parameter of a drawn joint
DIAGNOSED_EVERY = 10.0  # [s]


def friction(index: int) -> Answer:
    """Friction learnt from a recording of a random machine, and the verdict that rests on it."""
    case, recorded, number = FRICTION[index]
    return {"case": case, **learnt(*recorded(number))}


def _paper(number: int) -> Learnable:
    one = random_joints.random_recording(SEED + number)
    # Gains known, the effort alone with noise, the position alone.
    batch = (lambda: one.batch, lambda: one.noisy(number), one.without_forces)[number % 3]()
    return batch, one.gains if number % 3 == 0 else None, one.speeds[0]


def _off_the_law(condition: str, number: int) -> Learnable:
    one = random_machines.random_recording(SEED + number, random_machines.CONDITIONS[condition])
    return one.batch, one.gains, one.speeds[0]


def _varying(kind: str, _: int) -> Learnable:
    batch, gains = varying_recording(kind)
    return batch, gains, float(batch.reference_velocity[0])


def _on_contact(contact: str, number: int) -> Learnable:
    rng = np.random.default_rng((SEED, number))
    one = elastic_joints.random_case(rng, contact, turns=number % 2 == 0)
    return one.samples, one.gains, float(one.samples.reference_velocity[0])


Learnable = tuple[Batch, Gains | None, float]  # with the commanded speed [rad/s]
FRICTION: tuple[tuple[str, Callable[[int], Learnable], int], ...] = (
    *(("paper's law", _paper, number) for number in range(40)),
    *((name, partial(_off_the_law, name), number)
      for name in random_machines.CONDITIONS if name != "base" for number in range(3)),
    *((f"to and fro, {kind}", partial(_varying, kind), 0) for kind in VARYING),
    *((f"contact {contact}", partial(_on_contact, contact), number)
      for contact in ("elasto_plastic", "lugre") for number in range(2)),
)  # fmt: skip


def learnt(batch: Batch, gains: Gains | None, speed: float) -> Answer:
    """Friction that a monitor has learnt from a recording, its margin and exact verdict."""
    monitor = JointMonitor(None, gains, adviser=lambda _: None, studies_at_once=True, at_arrest=True)
    monitor.process(batch)
    monitor.finish()
    state = monitor.assessment(speed)
    return {
        "cycles": state.cycles,
        "estimate": None if state.estimate is None else estimate_json(state.estimate, state.position),
        "presliding": plain(state.presliding),
        "change": plain(state.change),
        "margin": plain(state.margin),
        "margin_std": state.margin_std,
        "stick_slip_probability": state.stick_slip_probability,
        "exact": plain(exact_of(state, state.margin_gains)),
    }


def estimate_json(estimate: FrictionEstimate, position: float) -> Answer:
    """Every parameter by its name, and how well the model fits."""
    found = {name: estimate[name] for name in (*NAMES, COULOMB_AND_LOAD)}
    found |= {"load": estimate.load, "natural_frequency": estimate.natural_frequency}
    numbers = ("slips", "aside", "mean_square", "left_over", "scatter", "mismatch", "usable", "law", "may_be_late")
    late = estimate.late
    return {
        **{name: plain(one) for name, one in found.items()},
        **{name: plain(getattr(estimate, name)) for name in numbers},
        "alternatives": {other.law: other.weight for other in estimate.alternatives},
        "delay": None if late is None else [late.viscous, late.spread, late.left, late.std, late.longest],
        "growth": growth_json(estimate, position),
        "curvature": numbers_or_null(estimate.curvature, ("value", "std", "speed")),
        "asymmetry": numbers_or_null(estimate.asymmetry, ("value", "std")),
        "dry": None if estimate.dry is None else dry_friction_json(estimate.dry),
    }


def exact_of(state: Assessment, gains: Gains | None, joint: Joint | None = None) -> ExactVerdict:
    """Exact verdict on an assessed joint, or on another one in its place, as the node works it out."""
    question = ExactQuestion.on(state, gains, OperatingConditions())
    if question is None:
        return NOT_COMPUTED
    return (question if joint is None else replace(question, joint=joint, uncertainty=None)).verdict()


ADVICE = ("limits", "uncertain", "loop", "per inertia", "every speed")
BEYOND_THE_PAPER = ("integral", "sampled", "elastic")  # loops whose advice is searched on a grid
_WITHIN_THE_PAPER = 94  # advices: those beyond the paper follow


def advice(index: int) -> Answer:
    """All variants of the advice on a random joint that sticks, by either condition, under one further demand."""
    condition, rng = list(Criterion)[index % 2], np.random.default_rng((SEED, index))
    case = random_advice.random_case(rng, condition)
    gains, limits, loop, uncertainty = case.gains, case.limits, ObservedLoop(), None
    joint, kind = case.joint, ADVICE[index // 2 % len(ADVICE)]
    omega = 2.0 * math.pi / natural_period(joint, gains)
    stretch = float(joint.friction.stribeck) / float(gains.stiffness)
    if index >= _WITHIN_THE_PAPER:
        kind, limits = BEYOND_THE_PAPER[index % 3], replace(limits, condition=Criterion.EXACT)
    if kind == "uncertain":
        uncertainty = Uncertainty(joint=_drawn(joint, rng), stiffness=np.ones(DRAWS), error_floor=0.01)
    elif kind == "loop":
        limits = replace(limits, effort=20.0 * float(joint.friction.stribeck), bandwidth=math.inf)
        loop = ObservedLoop(sample_rate=50.0 * omega, tracking_error=2.0 * stretch, velocity_error=omega * stretch)
    elif kind == "every speed":
        limits = replace(limits, slowest_velocity=0.3 * case.velocity)
    elif kind == "integral":
        gains = replace(gains, integral=0.05 * float(gains.stiffness) * omega)
    elif kind == "sampled":
        loop = ObservedLoop(conditions=OperatingConditions(controller_period=0.05 / omega))
    elif kind == "elastic":
        joint = with_contact(joint, 100.0 * float(gains.stiffness), "elasto_plastic")
    found = advise(
        AdviceQuestion(
            joint=joint, gains=gains, velocity=case.velocity, limits=limits, uncertainty=uncertainty, loop=loop,
            gains_known=kind != "per inertia",
        )
    )  # fmt: skip
    return {
        "case": f"{kind}, {limits.condition.value}",
        "reserve": found.recommendation.reserve,
        "lowest_smooth_velocity": found.lowest_smooth_velocity,
        "advice": recommendation_json(found.recommendation, found.sensitivities),
    }


def _drawn(joint: Joint, rng: np.random.Generator) -> Joint:
    """Joints as one of arrays, spread about this one."""
    names = ("stribeck", "stribeck_velocity", "lag", "rise_time", "viscous")
    numbers = {name: np.full(DRAWS, float(value)) for name, value in joint.friction.numbers.items()}
    for name in names:
        numbers[name] = numbers[name] * np.exp(DRAWN_STD * rng.standard_normal(DRAWS))
    return Joint(inertia=np.full(DRAWS, float(joint.inertia)), friction=joint.friction.changed(numbers))


def _configured() -> Run:
    return KNOWN.joint, *two_speeds_recording(0)


def _gains_known() -> Run:
    one = random_joints.random_recording(SEED)
    return None, one.batch, one.gains


def _nothing_known() -> Run:
    return None, random_joints.random_recording(SEED).without_forces(), None


def _varies() -> Run:
    return None, *varying_recording(varying_machines.LOAD)


Run = tuple[Joint | None, Batch, Gains | None]
RUNS: tuple[tuple[str, Callable[[], Run]], ...] = (
    ("friction configured", _configured),
    ("gains known", _gains_known),
    ("nothing known", _nothing_known),
    ("friction varies with load", _varies),
)


def diagnostics(index: int) -> Answer:
    """Statuses that the monitor publishes of a joint, every ten seconds and after five of silence, and its cycles."""
    case, run = RUNS[index]
    configured, batch, gains = run()
    trial = None if gains is None else replace(gains, stiffness=3.0 * float(gains.stiffness))
    monitor = JointMonitor(configured, gains, MonitorOptions(trial=trial), studies_at_once=True, at_arrest=True)
    statuses, cycles = [], []
    parts = np.floor((batch.time - batch.time[0]) / DIAGNOSED_EVERY)
    for part in np.unique(parts):
        cycles += monitor.process(batch.where(parts == part))
        statuses.append(_published(monitor, None))
    cycles += monitor.finish()
    statuses.append(_published(monitor, 5.0))
    return {
        "case": case,
        "statuses": statuses,
        "cycles": [_diagnosis(cycle_diagnostic("joint1", cycle)) for cycle in cycles],
    }


def _published(monitor: JointMonitor, silent_for: float | None) -> Answer:
    """Status on /diagnostics, and row of `~/margins`."""
    state = monitor.assessment()
    exact = exact_of(state, state.margin_gains)
    trial = exact_of(state, state.trial if state.gains_known else None)
    here = None if state.here is None else exact_of(state, state.margin_gains, state.here)
    found = Findings(assessment=state, exact=exact, trial=trial, here=here, silent_for=silent_for)
    status = joint_diagnostic("joint1", found, monitor.options.warn_margin)
    return _diagnosis(status) | {"margins": dict(zip(MARGIN_FIELDS, margin_row(found), strict=True))}


def _diagnosis(found: Diagnosis) -> Answer:
    """A status with its numbers as numbers, so that they are compared as such."""
    return {
        "level": int(found.level),
        "message": found.message,
        "values": {key: _number_or_text(value) for key, value in found.values},
    }


def _number_or_text(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value
