# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The page of `stickslip watch --browser`: a table of all joints, and of one of them motion, cycle, map and advice; and
its server, for this machine alone unless more is asked for.
"""

from __future__ import annotations

import html
import math
import multiprocessing
import threading
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from bokeh import models
from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.core.templates import get_env
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.server.server import Server
from jinja2 import Template
from rclpy.qos import ReliabilityPolicy

from stickslip_ros.analysis.report.page import number_text, static_text
from stickslip_ros.analysis.report.plots import BLUE, GREEN, GREY, INK, ORANGE, RED, new_figure, velocity_of
from stickslip_ros.cli.monitor_client import WatchListener, number_of
from stickslip_ros.cli.terminal import console_of_text
from stickslip_ros.cli.watch_view import MARKS, JointView, worst_first
from stickslip_ros.errors import InvalidParameterError, reason
from stickslip_ros.interrupts import check, without_interrupts, woken
from stickslip_ros.model.extinction_map import ExtinctionMap
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.output.as_json import margin_json
from stickslip_ros.output.diagnosis import Level
from stickslip_ros.output.published import published_joint
from stickslip_ros.output.stability_map import MapSubject, map_of
from stickslip_ros.output.wording import OUTCOME_TEXTS, counted, status_words
from stickslip_ros.parent_death import die_with_parent
from stickslip_ros.visible import full_name

_HERE = "127.0.0.1"
_PAGE = """{% extends base %}
{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,"><style>STYLE</style>{% endblock %}
{% block postamble %}<script>SCRIPT</script>{% endblock %}
"""
_EVERY = 500  # [ms]
_SILENT = 3.0  # [s] from when on it is said
_MOST_POINTS = 1500  # of a curve
_MAP_POINTS = 400
_LEAST_SAMPLES = 8  # of a loop
_SHOWN = 10.0  # [s] of motion
_CLASSES = {Level.ERROR: "bad", Level.WARN: "warn", Level.STALE: "none", Level.OK: "good"}
_MOVED = 1e-3  # relative change of what a map depends on
_DECADES = 1.0  # of the slider on either side of the present stiffness
_ADVISED = "#116329"
_COLOURS = (RED, ORANGE, GREEN, GREY)  # of the outcomes of a map
_LISTENED = 0.1  # [s] at once
_KEPT = 20_000  # rows of a joint's motion
_NONE = np.zeros((0, 3))


class LivePage:
    """One browser's page; :meth:`close` when it has gone.

    Parameters
    ----------
    work : where maps and verdicts are worked out, outside of the server's own process.
    """

    def __init__(self, document: Document, listener: LiveListener, work: Executor) -> None:
        self._document, self._listener, self._work = document, listener, work
        self._joint = ""
        self._shown: dict[str, str] = {}
        self._map_of: MapSubject | None = None
        self._pending_map: tuple[MapSubject, Future[ExtinctionMap]] | None = None
        self._pending_if: tuple[MapSubject, Future[dict[str, Any]]] | None = None
        self._subject: MapSubject | None = None  # what is predicted of the chosen joint, None if nothing can be
        self._sheet = sheet = models.InlineStyleSheet(css=static_text("live.css"))

        def words() -> models.Div:
            return models.Div(text="", sizing_mode="stretch_width", stylesheets=[sheet])

        self._header, self._table, self._advice, self._answer = words(), words(), words(), words()
        self._table.name, self._answer.name = "table", "answer"
        self._choice = models.Select(title="joint", options=[], name="joint", width=260, stylesheets=[sheet])
        self._choice.on_change("value", lambda _, __, name: self._choose(name))
        self._motion = models.ColumnDataSource({key: [0.0] for key in ("time", "position", "reference")})
        self._loop = models.ColumnDataSource({key: [0.0] for key in ("error", "velocity")})
        self._cells = models.ColumnDataSource({key: [] for key in ("left", "right", "bottom", "top", "colour")})
        self._points = models.ColumnDataSource({"speed": [], "stiffness": [], "colour": []})
        self._speeds, self._stiffnesses = models.Range1d(1e-4, 1.0), models.Range1d(1.0, 1e5)
        three_digits = models.CustomJSTickFormatter(code="return (10 ** tick).toPrecision(3)")
        self._stiffness = models.Slider(
            start=0, end=1, value=0, step=0.01, title="try a stiffness k_p [N·m/rad]", name="stiffness",
            format=three_digits, sizing_mode="stretch_width",
        )  # fmt: skip
        self._damping = models.Slider(
            start=0, end=1, value=0, step=0.01, title="try a damping k_v [N·m·s/rad]", name="damping",
            sizing_mode="stretch_width",
        )  # fmt: skip
        for slider in (self._stiffness, self._damping):
            slider.on_change("value_throttled", lambda _, __, ___: self._slide())
        document.title = "stick-slip, live"
        document.add_root(self._layout())
        document.js_on_event(DocumentReady, models.CustomJS(code=static_text("live.js")))
        document.add_periodic_callback(self.update, _EVERY)
        self.update()

    def close(self) -> None:
        """Nobody looks any more."""
        if self._joint:
            self._listener.look_away(self._joint)

    def _layout(self) -> Any:
        motion = new_figure("time before now [s]", "position [rad]", height=280)
        motion.line("time", "reference", source=self._motion, color=ORANGE, line_width=1.5, legend_label="reference")
        motion.line("time", "position", source=self._motion, color=BLUE, line_width=2, legend_label="position")
        motion.legend.location = "top_left"
        motion.x_range = models.Range1d(-_SHOWN, 0.0)
        loop = new_figure("position less reference [mrad]", "velocity [rad/s]", height=280)
        loop.line("error", "velocity", source=self._loop, color=BLUE, line_width=2)
        where = new_figure("commanded speed [rad/s]", "stiffness [N·m/rad]", height=280, log=True)
        where.quad(
            left="left", right="right", bottom="bottom", top="top", fill_color="colour", fill_alpha=0.3,
            line_color=None, source=self._cells,
        )  # fmt: skip
        where.scatter("speed", "stiffness", source=self._points, size=13, color="colour", line_color=INK)
        where.x_range, where.y_range = self._speeds, self._stiffnesses

        def titled(text: str, figure: Any) -> Any:
            return column(
                models.Div(text=f"<b>{text}</b>"), figure, sizing_mode="stretch_width", styles={"flex": "1 1 22rem"}
            )

        plots = row(
            titled("Motion of the last seconds", motion),
            titled("The latest cycle", loop),
            titled("Predicted: sticks (red), swings (orange), steady (green). Blue: now; dark green: advised", where),
            sizing_mode="stretch_width", styles={"flex-wrap": "wrap"},
        )  # fmt: skip
        return column(
            models.Div(text="<h1>Stick-slip, live</h1>", stylesheets=[self._sheet]),
            self._header, self._table, self._choice, self._advice, plots,
            self._stiffness, self._damping, self._answer, sizing_mode="stretch_width",
        )  # fmt: skip

    def update(self) -> None:
        """Send what has changed."""
        now = self._listener.snapshot
        ordered = worst_first(now.joints)
        names = [one.name for one in ordered]
        if sorted(self._choice.options) != sorted(names):
            self._choice.options = names
        if not self._joint and names:
            self._choice.value = names[0]
        self._write(self._header, _header(now, len(ordered)))
        self._write(self._table, joint_table(ordered, self._joint))
        chosen = next((one for one in ordered if one.name == self._joint), None)
        if chosen is not None:
            self._show(chosen, now)

    def _write(self, place: models.Div, text: str) -> None:
        if self._shown.get(place.id) != text:
            self._shown[place.id] = text
            place.text = text

    def _choose(self, name: str) -> None:
        if self._joint:
            self._listener.look_away(self._joint)
        self._joint, self._subject, self._map_of = name, None, None
        # What was asked about another joint is not answered here.
        self._pending_map, self._pending_if = None, None
        self._write(self._answer, "")
        self._listener.look_at(name)
        self._cells.data = {key: [] for key in self._cells.data}
        self.update()

    def _show(self, joint: JointView, now: Snapshot) -> None:
        values = joint.values
        numbers = {key: number for key, text in values.items() if math.isfinite(number := number_of(text))}
        self._write(self._advice, advice_text(joint))
        self._show_motion(joint.name, now, numbers)
        model, gains, before = published_joint(values), _gains(numbers, ""), self._subject
        if model is None or gains is None or not 0.0 < abs(joint.velocity) < math.inf:
            self._subject = None
            self._write(
                self._answer, "<p>What other gains would do is worked out once friction and gains are known.</p>"
            )
            return
        self._subject = subject = MapSubject(joint=model, gains=gains, velocity=abs(joint.velocity))
        self._show_map(subject, _gains(numbers, "recommended "))
        if before is None or before.gains != gains:
            self._set_sliders(subject)
        self._slide()

    def _show_motion(self, name: str, now: Snapshot, numbers: Mapping[str, float]) -> None:
        samples, references = now.samples.get(name, _NONE), now.references.get(name, _NONE)
        if not len(samples):
            self._motion.data = {key: [] for key in self._motion.data}
            self._loop.data = {key: [] for key in self._loop.data}
            return
        rows = _thinned(samples[samples[:, 0] >= samples[-1, 0] - _SHOWN])
        desired = (
            np.interp(rows[:, 0], references[:, 0], references[:, 1], left=math.nan)
            if len(references)
            else np.full(len(rows), math.nan)
        )
        self._motion.data = {"time": rows[:, 0] - samples[-1, 0], "position": rows[:, 1], "reference": desired}
        error, velocity = phase_loop(samples, references, cycle_duration(numbers))
        kept = slice(None, None, max(1, math.ceil(len(error) / _MOST_POINTS)))
        self._loop.data = {"error": 1e3 * error[kept], "velocity": velocity[kept]}

    def _show_map(self, subject: MapSubject, advised: Gains | None) -> None:
        points = [(subject.gains, BLUE)] + ([(advised, _ADVISED)] if advised is not None else [])
        self._points.data = {
            "speed": [subject.velocity] * len(points),
            "stiffness": [float(gains.stiffness) for gains, _ in points],
            "colour": [colour for _, colour in points],
        }
        if self._pending_map is not None and self._pending_map[1].done():
            requested, answer = self._pending_map
            self._pending_map = None
            if answer.exception() is None:
                self._map_of = requested
                self._cells.data = cells = _cells(answer.result(), float(requested.gains.damping))
                self._speeds.update(start=float(cells["left"].min()), end=float(cells["right"].max()))
                self._stiffnesses.update(start=float(cells["bottom"].min()), end=float(cells["top"].max()))
        due = self._map_of is None or not _similar(self._map_of, subject)
        if due and self._pending_map is None and float(subject.gains.stiffness) > 0.0:
            self._pending_map = (subject, self._work.submit(map_of, subject, _MAP_POINTS))

    def _set_sliders(self, subject: MapSubject) -> None:
        """At the present gains; a decade of stiffness either way, and damping up to twice the critical one of a joint
        without friction.
        """
        stiffness, damping = float(subject.gains.stiffness), float(subject.gains.damping)
        now = math.log10(stiffness) if stiffness > 0.0 else 0.0
        self._stiffness.update(start=now - _DECADES, end=now + _DECADES, value=now)
        end = max(2.0 * damping, 4.0 * math.sqrt(max(stiffness, 1.0) * float(subject.joint.inertia)))
        self._damping.update(start=min(0.0, damping), end=end, step=_digits(end / 200.0), value=damping)

    def _slide(self) -> None:
        """Work out what the sliders' gains would do; what was asked in between is passed over."""
        if self._subject is None:
            return
        gains = Gains(stiffness=_digits(10.0**self._stiffness.value), damping=_digits(self._damping.value))
        wanted = replace(self._subject, gains=gains)
        if self._pending_if is not None and self._pending_if[1].done():
            requested, answer = self._pending_if
            self._pending_if = None
            if answer.exception() is None:
                self._write(self._answer, _answer(requested, answer.result()))
        if self._pending_if is None:
            self._pending_if = (wanted, self._work.submit(margin_json, wanted.joint, gains, wanted.velocity))


def _gains(numbers: Mapping[str, float], before: str) -> Gains | None:
    stiffness, damping = (numbers.get(f"{before}{name}") for name in ("stiffness [N*m/rad]", "damping [N*m*s/rad]"))
    return None if stiffness is None or damping is None else Gains(stiffness=stiffness, damping=damping)


def _header(now: Snapshot, joints: int) -> str:
    if now.silent_for > _SILENT:
        since = "yet" if math.isinf(now.silent_for) else f"for {now.silent_for:.0f} s"
        return f"<p class='bad'>No monitor has said anything {since}. This page goes on by itself when one does.</p>"
    lines = "<br>".join(html.escape(line) for line in now.header.splitlines())
    return f"<p class='faint'>{counted(joints, 'joint')}. {lines}</p>"


def joint_table(joints: list[JointView], chosen: str) -> str:
    """A row for each joint, as HTML; what others named is escaped."""
    rows = []
    for one in joints:
        name = html.escape(one.name, quote=True)
        reserve = "–" if math.isnan(one.reserve) else f"{100.0 * min(one.reserve, 10.0):+.0f}"
        rows.append(
            f"<tr data-joint='{name}' class='{'chosen' if one.name == chosen else ''}'><td>{name}</td>"
            f"<td class='{_CLASSES[one.level]}'>{MARKS[one.level]} {html.escape(status_words(one.status))}</td>"
            f"<td class='number'>{number_text(one.velocity)}</td><td>{html.escape(one.outcome or '–')}</td>"
            f"<td class='number'>{reserve}</td><td class='number'>{one.cycles}</td>"
            f"<td class='number'>{number_text(1e3 * one.slip)}</td></tr>"
        )
    heads = "".join(
        f"<th{' class=number' if number else ''}>{head}</th>"
        for head, number in (
            ("joint", False), ("status", False), ("commanded speed [rad/s]", True), ("model predicts", False),
            ("damping reserve [%]", True), ("slips", True), ("last slip [mrad]", True),
        )
    )  # fmt: skip
    return f"<div class='list'><table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"


def advice_text(joint: JointView) -> str:
    """What to do about a joint, and why, as HTML."""
    name, message = html.escape(joint.name), html.escape(joint.message.replace("stick_slip", "stick-slip"))
    why = joint.values.get("recommendation", "") or joint.values.get("margin reason", "")
    more = f"<br>{html.escape(why)}" if why and why not in joint.message else ""
    return f"<p class='{_CLASSES[joint.level]} todo'><b>{name}</b>: {message}{more}</p>"


def _answer(subject: MapSubject, found: Mapping[str, Any]) -> str:
    """What gains would do, in words."""
    exact = found["exact"]
    outcome = exact.get("outcome")
    does = "cannot be judged" if outcome is None else OUTCOME_TEXTS[Outcome(outcome)]
    spare = exact["damping_reserve"]
    reserve = "" if spare is None else f"; damping reserve {100.0 * spare:+.0f} %"
    word = {"sticks": "bad", "swings": "warn", "steady": "good"}.get(outcome or "", "none")
    return (
        f"<p>With k_p {float(subject.gains.stiffness):.4g} N·m/rad and k_v {float(subject.gains.damping):.4g} N·m·s/rad"
        f" at {subject.velocity:.3g} rad/s the model predicts: the joint <b class='{word}'>{does}</b>{reserve}. "
        "<span class='faint'>Computed in this page's server; nothing is written to the robot.</span></p>"
    )


def _digits(value: float) -> float:
    """As the slider shows it."""
    return float(f"{value:.3g}")


def _thinned(rows: FloatArray) -> FloatArray:
    return rows[:: max(1, math.ceil(len(rows) / _MOST_POINTS))]


def _similar(one: MapSubject, other: MapSubject) -> bool:
    """Whether the maps of both look the same."""

    def numbers(subject: MapSubject) -> list[float]:
        return [*map(float, subject.joint.numbers.values()), float(subject.gains.damping)]

    same = all(
        math.isclose(a, b, rel_tol=_MOVED, abs_tol=1e-12) for a, b in zip(numbers(one), numbers(other), strict=True)
    )
    near = math.isclose(one.velocity, other.velocity, rel_tol=0.5)
    return same and near and math.isclose(float(one.gains.stiffness), float(other.gains.stiffness), rel_tol=0.5)


def _cells(found: ExtinctionMap, damping: float) -> dict[str, Any]:
    """A rectangle about each point of the map, in the colour of what happens there."""
    outcomes = found.outcomes(damping)
    across, along = _edges(found.velocity), _edges(found.stiffness)
    rows, columns = (index.ravel() for index in np.indices(outcomes.shape))
    return {
        "left": across[columns], "right": across[columns + 1], "bottom": along[rows], "top": along[rows + 1],
        "colour": [_COLOURS[index] for index in outcomes.ravel()],
    }  # fmt: skip


def _edges(values: FloatArray) -> FloatArray:
    """Half-way between neighbours on the geometric axis of a map."""
    half = np.sqrt(values[1] / values[0])
    return np.append(values / half, values[-1] * half)


def phase_loop(samples: FloatArray, references: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
    """The last seconds in the phase plane: position less its reference, or less an even motion [rad]; velocity [rad/s].

    Parameters
    ----------
    samples : rows of time, position and velocity. references : rows of time and position, none where none is known.
    """
    empty = np.zeros(0)
    if not len(samples):
        return empty, empty
    rows = samples[samples[:, 0] >= samples[-1, 0] - duration]
    rows = rows[np.isfinite(rows[:, :2]).all(axis=1)]
    if len(rows) < _LEAST_SAMPLES or not rows[-1, 0] > rows[0, 0]:
        return empty, empty
    time, position, velocity = rows[:, 0], rows[:, 1], velocity_of(*rows.T)
    if len(references) and references[-1, 0] >= time[0]:
        desired = np.interp(time, references[:, 0], references[:, 1])
    else:
        desired = position[0] + (position[-1] - position[0]) * (time - time[0]) / (time[-1] - time[0])
    return position - desired, velocity


def cycle_duration(values: Mapping[str, float]) -> float:
    """How long to look back for one cycle [s]: the last one's length and a little more; three seconds without any."""
    dwell, slip = values.get("last dwell [s]", math.nan), values.get("last slip duration [s]", math.nan)
    period = dwell + slip
    return min(max(1.3 * period, 0.5), 20.0) if math.isfinite(period) else 3.0


def serve(address: str, port: int) -> None:
    """Serve the page until a signal ends it.

    Raises
    ------
    Interrupted
        When one does.
    InvalidParameterError
        If the port is taken, or the address is none of this machine.
    """
    console = console_of_text(stderr=True)
    # Compiled code holds Python's lock: what takes a second is worked out in a process of its own.
    context = multiprocessing.get_context("spawn")
    with LiveListener() as listener, ProcessPoolExecutor(1, context, die_with_parent) as work:
        # The process is begun by the first question.
        with without_interrupts():
            work.submit(int)

        def begin(document: Document) -> None:
            document.template = _template()
            page = LivePage(document, listener, work)
            document.on_session_destroyed(lambda _: page.close())

        names = ("localhost", _HERE) if address == _HERE else ("*",)
        try:
            server = Server(
                {"/": Application(FunctionHandler(begin))}, address=address, port=port,
                allow_websocket_origin=[f"{name}:{port}" for name in names],
                check_unused_sessions_milliseconds=2000, unused_session_lifetime_milliseconds=5000,
            )  # fmt: skip
        except OSError as error:
            raise InvalidParameterError(
                "--port", f"free, and --address one of this machine ({reason(error)})", f"{address}:{port}"
            ) from error
        console.print(f"http://{address}:{port} shows every joint; Ctrl-C ends it.")
        try:
            server.start()
            with woken(lambda: server.io_loop.add_callback(server.io_loop.stop)):
                server.io_loop.start()
            check()
        finally:
            server.stop()
            work.shutdown(wait=False, cancel_futures=True)


def _template() -> Template:
    style, script = map(static_text, ("style.css", "page.js"))
    # Bokeh's own style comes later, and leaves a body no margin.
    wide = "html > body { max-width: 100rem; margin: 0 auto; padding: 1rem; }"
    template: Template = get_env().from_string(_PAGE.replace("STYLE", style + wide).replace("SCRIPT", script))
    return template


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """What is known at one moment.

    Attributes
    ----------
    joints, header : as the terminal's view has them.
    silent_for : how long no monitor has said anything [s]; infinite before the first word.
    samples, references : rows of time, position and velocity of each joint that is looked at.
    """

    joints: tuple[JointView, ...] = ()
    header: str = ""
    silent_for: float = math.inf
    samples: Mapping[str, FloatArray] = field(default_factory=dict)
    references: Mapping[str, FloatArray] = field(default_factory=dict)


class LiveListener:
    """A context manager: the thread ends with it.

    Attributes
    ----------
    snapshot : the latest; it is never changed, but replaced.
    """

    def __init__(self) -> None:
        self.snapshot = Snapshot()
        self._listener = WatchListener()
        self._looked_at: Counter[str] = Counter()  # by how many pages
        self._lock = threading.Lock()
        self._motions: dict[str, tuple[JointStateTopic, JointStateTopic]] = {}
        self._samples: dict[str, FloatArray] = {}
        self._references: dict[str, FloatArray] = {}
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listener", daemon=True)

    def __enter__(self) -> LiveListener:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join(5.0)
        self._listener.close()

    def look_at(self, joint: str) -> None:
        """Somebody looks at a joint: its motion is kept from now on."""
        with self._lock:
            self._looked_at[joint] += 1

    def look_away(self, joint: str) -> None:
        """Somebody does no more."""
        with self._lock:
            self._looked_at[joint] -= 1

    def _run(self) -> None:
        while not self._ending.is_set():
            self._listener.listen(_LISTENED)
            with self._lock:
                looked_at = set(+self._looked_at)
            self._follow(looked_at)
            self.snapshot = Snapshot(
                joints=tuple(self._listener.joints()),
                header=self._listener.header(),
                silent_for=self._listener.silent_for,
                samples=dict(self._samples),
                references=dict(self._references),
            )

    def _follow(self, looked_at: set[str]) -> None:
        """Take the motion of the joints that are looked at, and leave the topics of all others."""
        robots = {joint.rpartition("/")[0] for joint in looked_at}
        for robot in [robot for robot in self._motions if robot not in robots]:
            for topic in self._motions.pop(robot):
                topic.close()
        for robot in robots - set(self._motions):
            self._motions[robot] = self._listener.motion(robot, ReliabilityPolicy.BEST_EFFORT)
        for kept in (self._samples, self._references):
            for joint in [joint for joint in kept if joint not in looked_at]:
                del kept[joint]
        now = time.monotonic()
        for robot, motion in self._motions.items():
            for topic, kept in zip(motion, (self._samples, self._references), strict=True):
                for name, rows in topic.samples_until(now).items():
                    joint = full_name(robot, name)
                    if joint in looked_at:
                        kept[joint] = _continued(kept.get(joint, _NONE), rows[:, :3])


def _continued(kept: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows and those that came after them, the latest ones; where time began anew what was before is dropped."""
    rows = rows[np.isfinite(rows[:, 0])]
    if len(kept) and len(rows) and rows[0, 0] < kept[-1, 0] - 1.0:
        kept = _NONE
    return np.concatenate([kept, rows])[-_KEPT:]
