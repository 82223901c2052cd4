# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A controller's parameters on a clock of their own: late, refusing, clamping, dead, and set by others meanwhile."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue, SetParametersResult

PATIENCE = 2.0  # [s], as RemoteParameters have it


@dataclass(frozen=True)
class Effect:
    """A change of the gains: when, by whom ("ramp" or "other"), what was set, and what was in force before."""

    time: float
    by: str
    values: dict[str, float]
    before: dict[str, float]


@dataclass
class LateController:
    """See the module; times [s].

    Attributes
    ----------
    delay : from a request to its effect, and from there to its answer. news : from an effect to its being told.
    mode : "takes", "refuses", "clamps" (half of the way), "ignores", "dead".
    on_set : called with every set as it is sent. requests : sets as they were sent, with the time.
    effects : changes as they came into force.
    """

    gains: dict[str, float]
    remote: str = "/controller"
    listeners: list[Callable[[Mapping[str, Any]], None]] = field(default_factory=list)
    delay: tuple[float, float] = (0.001, 0.001)
    news: float = 0.002
    mode: str = "takes"
    now: float = 0.0
    stalled: bool = False
    on_set: Callable[[dict[str, float]], None] = lambda _: None
    requests: list[tuple[float, dict[str, float]]] = field(default_factory=list)
    effects: list[Effect] = field(default_factory=list)
    _due: list[tuple[float, int, Callable[[], None]]] = field(default_factory=list)
    _held: list[Callable[[], None]] = field(default_factory=list)
    _numbers: Any = field(default_factory=itertools.count)
    _waiting: list[tuple[float, Callable[[Any], None]]] = field(default_factory=list)
    _busy_until: float = 0.0

    def get(self, names: Sequence[str], now: float, then: Callable[[Any], None]) -> None:
        """Answer with the values at the time at which the question is looked at."""
        answered = self._question(now, then)

        def look() -> None:
            if self.mode != "dead":
                values = [self._value(self.gains[name.rpartition(".")[2]]) for name in names]
                self._at(self.now + self.delay[1], lambda: self._deliver(lambda: answered(values)))

        self._at(self._turn(now), look)

    def set(self, values: Mapping[str, float], now: float, then: Callable[[Any], None]) -> None:
        """Take values, or not, and answer."""
        plain = {name.rpartition(".")[2]: value for name, value in values.items()}
        self.requests.append((now, plain))
        self.on_set(plain)
        answered = self._question(now, then)

        def look() -> None:
            if self.mode == "dead":
                return
            result = SetParametersResult(successful=self.mode != "refuses")
            if self.mode in ("takes", "clamps"):
                half = 0.5 if self.mode == "clamps" else 0.0
                self._change("ramp", {k: v + half * (self.gains[k] - v) for k, v in plain.items()})
            self._at(self.now + self.delay[1], lambda: self._deliver(lambda: answered(result)))

        self._at(self._turn(now), look)

    def poll(self, now: float) -> None:
        """Give None where an answer is overdue."""
        overdue = [one for one in self._waiting if now > one[0]]
        for one in overdue:
            self._waiting.remove(one)
            one[1](None)

    @property
    def busy(self) -> float:
        """How long a question waits until it is looked at."""
        return max(self._busy_until - self.now, 0.0) + self.delay[0]

    def others_set(self, values: dict[str, float]) -> None:
        """Somebody else's change, which is in force at once."""
        self._change("other", values)

    def forget_the_one_who_asks(self) -> None:
        """Its process is gone; what it sent is under way."""
        self.listeners.clear()
        self._waiting.clear()
        self._held.clear()

    def run(self, until: float) -> None:
        """Let everything happen that is due."""
        while self._due and self._due[0][0] <= until:
            self.now, _, what = heapq.heappop(self._due)
            what()
        self.now = until
        if not self.stalled:
            held, self._held = self._held, []
            for what in held:
                what()

    def _change(self, by: str, values: dict[str, float]) -> None:
        self.effects.append(Effect(self.now, by, dict(values), dict(self.gains)))
        self.gains.update(values)
        told = {f"gains.joint1.{kind}": self._value(value) for kind, value in values.items()}
        self._at(self.now + self.news, lambda: self._deliver(lambda: [hear(told) for hear in list(self.listeners)]))

    def _question(self, now: float, then: Callable[[Any], None]) -> Callable[[Any], None]:
        one = (now + PATIENCE, then)
        self._waiting.append(one)

        def answered(answer: Any) -> None:
            if one in self._waiting:
                self._waiting.remove(one)
                then(answer)

        return answered

    def _turn(self, now: float) -> float:
        """Questions are looked at one after the other."""
        self._busy_until = max(self._busy_until, now + self.delay[0])
        return self._busy_until

    def _at(self, time: float, what: Callable[[], None]) -> None:
        heapq.heappush(self._due, (time, next(self._numbers), what))

    def _deliver(self, what: Callable[[], None]) -> None:
        if self.stalled:
            self._held.append(what)
        else:
            what()

    @staticmethod
    def _value(value: float) -> ParameterValue:
        assert math.isfinite(value)
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
