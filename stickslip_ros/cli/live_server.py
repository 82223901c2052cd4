# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The server of `stickslip watch --browser`: Bokeh's, for this machine alone unless more is asked for."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from importlib import resources

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import Server
from jinja2 import Template

from stickslip_ros.cli.live_listener import LiveListener
from stickslip_ros.cli.live_page import LivePage
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.errors import InvalidParameterError, reason
from stickslip_ros.interrupts import check, without_interrupts, woken
from stickslip_ros.parent_death import die_with_parent

_HERE = "127.0.0.1"
_PAGE = """{% extends base %}
{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,"><style>STYLE</style>{% endblock %}
{% block postamble %}<script>SCRIPT</script>{% endblock %}
"""


def serve(address: str, port: int) -> None:
    """Serve the page until a signal ends it.

    Raises
    ------
    Interrupted
        When one does.
    InvalidParameterError
        If the port is taken, or the address is none of this machine.
    """
    console = Terminal(stderr=True, highlight=False, soft_wrap=True)
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
    from bokeh.core.templates import get_env

    folder = resources.files("stickslip_ros.analysis.report").joinpath("static")
    style, script = (folder.joinpath(name).read_text(encoding="utf-8") for name in ("style.css", "page.js"))
    # Bokeh's own style comes later, and leaves a body no margin.
    wide = "html > body { max-width: 100rem; margin: 0 auto; padding: 1rem; }"
    template: Template = get_env().from_string(_PAGE.replace("STYLE", style + wide).replace("SCRIPT", script))
    return template
