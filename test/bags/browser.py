# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A real browser without a window, for looking at pages; waits are bounded."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

_ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--no-first-run",
    # Nothing outside of this machine is to be had: pages must need no network.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip


class Page:
    """A page that is open in the browser."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def run(self, script: str) -> Any:
        """The value that a script returns."""
        return self.driver.execute_script(script)

    def wait(self, reached: Callable[[], bool], what: str, limit: float = 30.0) -> None:
        """Wait until something is so; fails after the limit [s]."""
        until = time.monotonic() + limit
        while not reached():
            assert time.monotonic() < until, f"waited {limit} s for {what}"
            time.sleep(0.05)

    def open(self, path: Path) -> None:
        """Load a file, and wait until its plots are drawn."""
        self.driver.get(path.as_uri())
        self.wait(lambda: self.run("return document.documentElement.dataset.plots") == "ready", "the plots")

    def prefer(self, scheme: str) -> None:
        """Let the reader prefer light or dark colours."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    def complaints(self) -> list[str]:
        """Errors and warnings of the console since the last call."""
        said = [one for one in self.driver.get_log("browser") if one["level"] in ("SEVERE", "WARNING")]
        # The tests' own looking at the canvases is slow, which the browser remarks.
        return [str(one["message"]) for one in said if "willReadFrequently" not in one["message"]]


@contextmanager
def browser(width: int = 1200, height: int = 900) -> Iterator[Page]:
    """A browser with a window of this size."""
    chromium, chromedriver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or chromedriver is None:
        if shutil.which("apt-get") is None or os.geteuid() != 0:
            pytest.skip("no chromium, and no right to install it (tools/install_test_packages.sh)")
        pytest.fail("no chromium: run tools/install_test_packages.sh")
    options = Options()
    options.binary_location = chromium
    for argument in (*_ARGUMENTS, f"--window-size={width},{height}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(chromedriver))
    try:
        yield Page(driver)
    finally:
        driver.quit()
