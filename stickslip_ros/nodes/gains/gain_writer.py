# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint's gains in its controller, read and written; no other module writes gains.

A controller's parameters can be read and set, but not compared and set in one step: between the answer to the last
question and the arrival of new gains somebody else may set gains. The controller's events of changes reveal it then.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from enum import Enum
from typing import Any, TypeVar

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.gain_parameters import GainPair, gain_name, gain_value, joint_and_kind
from stickslip_ros.nodes.gains.remote_parameters import PATIENCE, RemoteParameters

_REQUEST_AGAIN = 1.4  # time until a question is repeated, s: an answer can be lost, and few controllers are slower
_OLD = 1.0  # age of gains from which it is reported, s
_EVENT_DELAY = 0.2  # time until the event of a change has come, s: the answer to the change comes first
_RESTORATIONS = 3  # number of restorations in a row, 1: somebody who goes on setting gains is left alone
_AS_READ = "as read"
_MOST_SENT = 64  # number of writes whose events are awaited, 1: events can be lost

T = TypeVar("T")


class Step(Enum):
    """What whoever runs a script does before it goes on with it; what objects is raised where the script stands."""

    WAIT = "wait for a tick or an answer, then check everything"
    WAIT_BLINDLY = "wait, and check nothing, because nothing is to be written"
    CHECK = "check everything now"
    CHECK_PERMISSION = "check now whether gains may be written"


Script = Generator[Step, None, T]


class StoppedError(StickSlipError):
    """A change of gains that cannot go on; the text has the reason."""


class WithdrawnError(StoppedError):
    """Gains may not be written any more."""

    def __init__(self) -> None:
        super().__init__("allow_apply was set to false, and nothing was written after that")


class SetByOthersError(StoppedError):
    """Somebody else has set gains.

    Attributes
    ----------
    values : the gains that they set, by "p" and "d".
    """

    def __init__(self, values: Mapping[str, float]) -> None:
        super().__init__("somebody else set gains")
        self.values = dict(values)


class GainWriter:
    """Reader and writer of one joint's gains. Methods that wait are scripts of :class:`Step`.

    Parameters
    ----------
    joint : its name. controller : has its gains. clock : a steady time [s].
    answered : called when an answer has come, to go on at once.

    Attributes
    ----------
    last : gains as read or confirmed last, None before any. written : gains sent last, None before any.
    silent : whether the controller did not answer the last question at all.
    """

    def __init__(
        self,
        joint: str,
        controller: RemoteParameters,
        *,
        clock: Callable[[], float],
        answered: Callable[[], None],
    ) -> None:
        self._joint, self._controller = joint, controller
        self._clock, self._answered = clock, answered
        self._names = [gain_name(joint, kind) for kind in ("p", "d")]
        self._changes_due: deque[dict[str, float]] = deque(maxlen=_MOST_SENT)
        self._others: list[dict[str, float]] = []
        self._reading: list[Any] = []
        self._requested_at = -math.inf
        self.written: GainPair | None = None
        self._unanswered: GainPair | None = None
        self._unanswered_since = -math.inf
        self._checking = False
        self.last: GainPair | None = None
        self._how_known, self._known_at = "", 0.0
        self.silent = False
        controller.listeners.append(self._on_changes)

    def close(self) -> None:
        """Stop listening."""
        if self._on_changes in self._controller.listeners:
            self._controller.listeners.remove(self._on_changes)

    def check_for_others(self) -> None:
        """Check whether somebody else has set gains.

        Raises
        ------
        SetByOthersError
            If somebody has. While a write is on its way nothing is raised: its result has to be read first.
        """
        if self._others and not self._checking:
            raise SetByOthersError(self._pop_others())

    def read(self, *, blindly: bool = False) -> Script[GainPair]:
        """The gains in force.

        Parameters
        ----------
        blindly : whether nothing is checked meanwhile, because nothing is to be written.

        Raises
        ------
        StoppedError
            If the controller does not answer, or has no such gains.
        """
        requests = 1
        if not blindly or self._requested_at <= self._unanswered_since or self._reading:
            self._reading, self._requested_at, requests = [], self._clock(), 0
        # Else the last question may still be answered, and a slow controller gets no second one.
        answers, begun = self._reading, self._requested_at
        while True:
            waited = self._clock() - begun
            if answers and (blindly or waited < PATIENCE):
                break
            # An answer that came in time and waited here, while this process had no time, is too old to write by.
            if waited >= PATIENCE:
                raise self._silence(answers)
            if waited >= requests * _REQUEST_AGAIN:
                requests += 1
                self._controller.get(self._names, self._clock(), lambda answer: self._process_answer(answer, answers))
                continue
            yield Step.WAIT_BLINDLY if blindly else Step.WAIT
        p, d = [*(gain_value(value) for value in answers[0]), math.nan, math.nan][:2]
        if math.isnan(p):
            raise StoppedError(f"{self._controller.remote} has no gain {self._names[0]}")
        # The answer has no time of its own; the gains were read no earlier than the question was sent.
        return self._note(GainPair(p, 0.0 if math.isnan(d) else d), _AS_READ, begun)

    def write(self, new: GainPair, expected: Sequence[GainPair]) -> Script[None]:
        """Write gains where expected gains are in force, and read them back.

        Raises
        ------
        SetByOthersError
            If other gains are in force, or were set meanwhile.
        WithdrawnError
            If gains may not be written.
        StoppedError
            If the controller refuses or changes the gains.
        """
        yield from self._last_answer()
        if self._unanswered is not None:
            raise self._silence(())
        old = yield from self.read()
        if not any(old.same(one) for one in expected):
            raise SetByOthersError(old.values())
        # The answer has just come, and gains read are never younger.
        yield Step.CHECK
        if old.same(new):
            return
        self._checking = True
        try:
            yield from self._write_and_check(old, new)
        finally:
            self._checking = False
        self.check_for_others()

    def _write_and_check(self, old: GainPair, new: GainPair) -> Script[None]:
        result = yield from self._sent(old.changes(new), new)
        if result.successful:
            self._note(new, "as confirmed, not read back", self._unanswered_since)
        found = yield from self.read()
        if found.same(new):
            return
        # The event of a change comes a little later than the answer.
        until = self._clock() + _EVENT_DELAY
        while self._clock() < until and not (self._confirmed or self._others):
            yield Step.WAIT
        remote = self._controller.remote
        if result.successful and not self._confirmed:
            if found.same(old):
                raise StoppedError(f"{remote} took no notice of {new}")
            if found.between(old, new):
                self._others.clear()
                yield from self._put_back(old, new, found)
        if result.successful or self._others or not found.same(old):
            raise SetByOthersError(self._pop_others() or found.values())
        raise StoppedError(f"{remote} refused {new}: {result.reason or 'no reason given'}")

    @property
    def _confirmed(self) -> bool:
        """Whether the controller has published the event of the last write."""
        return not self._changes_due

    def _put_back(self, old: GainPair, new: GainPair, found: GainPair) -> Script[None]:
        """Restore the gains that the controller accepted last, after it changed the new ones."""
        yield from self._sent(found.changes(old), old)
        after = yield from self.read()
        made = f"{self._controller.remote} made {found} of {new}"
        raise StoppedError(made if after.same(old) else f"{made}, and {after} of {old}")

    def restore(self, values: Mapping[str, float]) -> Script[str]:
        """Restore gains that somebody else set and a write of ours undid; returns a sentence on it.

        Raises
        ------
        StoppedError
            If the controller does not answer.
        """
        self._checking = True
        report = ""
        for _ in range(_RESTORATIONS):
            found = yield from self.settled()
            if self._unanswered is not None:
                raise self._silence(())
            values = {**values, **self._pop_others()}
            theirs = ", ".join(f"{kind} {value:.6g}" for kind, value in values.items())
            # A value that is neither theirs nor ours was set later, by somebody else.
            ours = self.written.values() if self.written is not None else {}
            wanted = found.changes(found.with_values(values))
            undone = {kind: value for kind, value in wanted.items() if found.values()[kind] == ours.get(kind)}
            if not undone:
                return report or f"somebody else set {theirs}; that is left alone"
            report = f"somebody else set {theirs}, which a write of the ramp undid"
            try:
                yield from self._sent(undone, found.with_values(undone))
            except WithdrawnError:
                return f"{report}; it was not put back, as allow_apply was set to false"
            report += "; it was put back"
            # The events of changes made meanwhile come a little later.
            until = self._clock() + _EVENT_DELAY
            while self._clock() < until:
                yield Step.WAIT_BLINDLY
        return report

    def settled(self) -> Script[GainPair]:
        """The gains in force once the last write is answered or overdue; nothing is checked meanwhile."""
        yield from self._last_answer(blindly=True)
        return (yield from self.read(blindly=True))

    def _last_answer(self, *, blindly: bool = False) -> Script[None]:
        """Wait until the last write is answered or overdue: gains read earlier may be replaced by it."""
        while self._unanswered is not None and self._clock() - self._unanswered_since < PATIENCE:
            yield Step.WAIT_BLINDLY if blindly else Step.WAIT

    @property
    def certain(self) -> bool:
        """Whether the last known gains were read after every write."""
        return self._unanswered is None and self._how_known == _AS_READ

    def in_force(self) -> str:
        """Sentence on the gains in force, as far as they are known."""
        if self.last is None:
            return "the gains in force are not known"
        ago = self._clock() - self._known_at
        old = f" {ago:.1f} s ago" if ago > _OLD else ""
        text = f"the gains in force are {self.last}, {self._how_known}{old}"
        if self._unanswered is not None:
            text += f"; {self._unanswered} was sent and not answered, and may come into force"
        return text

    def _sent(self, values: dict[str, float], new: GainPair) -> Script[Any]:
        """Write gains, and wait for the answer; no other method writes."""
        yield Step.CHECK_PERMISSION
        answers: list[Any] = []
        self._changes_due.append(values)
        self.written = self._unanswered = new
        self._unanswered_since = self._clock()

        def answered(answer: Any) -> None:
            if self._unanswered is new and answer is not None:
                self._unanswered = None
            self._process_answer(answer, answers)

        named = {gain_name(self._joint, kind): value for kind, value in values.items()}
        self._controller.set(named, self._clock(), answered)
        while True:
            if self._clock() - self._unanswered_since >= PATIENCE:
                raise self._silence(answers)
            if answers:
                return answers[0]
            yield Step.WAIT

    def _silence(self, too_late: Sequence[Any]) -> StoppedError:
        self.silent = not too_late
        return StoppedError(f"{self._controller.remote} has not answered for {PATIENCE:g} s")

    def _process_answer(self, answer: Any, answers: list[Any]) -> None:
        if answer is not None:
            answers.append(answer)
            self._answered()

    def _note(self, gains: GainPair, how: str, since: float) -> GainPair:
        self.last, self._how_known, self._known_at = gains, how, since
        return gains

    def _pop_others(self) -> dict[str, float]:
        others = {kind: value for announced in self._others for kind, value in announced.items()}
        self._others.clear()
        return others

    def _on_changes(self, changes: Mapping[str, Any]) -> None:
        """Distinguish our own changes, of which the controller publishes events too, from those of others."""
        announced = {}
        for name, value in changes.items():
            found = joint_and_kind(name)
            if found is not None and found[0] == self._joint and found[1] in ("p", "d"):
                announced[found[1]] = gain_value(value)
        if not announced:
            return
        for number, due in enumerate(self._changes_due):
            if due == announced:
                for _ in range(number + 1):
                    self._changes_due.popleft()
                if self._unanswered is not None and self._confirmed and self.last is not None:
                    # The event is as good as an answer, which may never come.
                    self._note(self._unanswered, "as it made known", self._clock())
                    self._unanswered = None
                return
        if not any(math.isnan(value) for value in announced.values()):
            self._others.append(announced)
