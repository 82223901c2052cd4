# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How functions are compiled by numba, and where the machine code is kept.

Three decorators. A ``kernel`` is called from Python, and kept on disk. A ``helper`` is called from compiled code alone:
it needs no wrapper and no file. An ``inlined`` helper becomes part of the one function that calls it, before types are
inferred; every level of calls that is saved so is one at which LLVM does not go through everything below it once more.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba import config, njit

from stickslip_ros.interrupts import at_hard_end

_PACKAGE = Path(__file__).resolve().parent
_GIVEN = "NUMBA_CACHE_DIR"
_NAME = "stickslip_ros-"
NOT_KEPT = (
    "what is compiled cannot be kept, as neither the package's folder nor ~/.cache can be written; "
    "set NUMBA_CACHE_DIR to a folder that can"
)
_COMMON = {"error_model": "numpy"}  # a division by zero is infinite, or NaN: arithmetic without a way out is smaller


@dataclass(frozen=True)
class CacheFolder:
    """Where machine code is kept; ``permanent``: whether it will be there at the next start."""

    path: Path
    permanent: bool = True


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of compiled functions that Python calls; options are numba's."""

    def decorate(function: Callable[..., Any]) -> Any:
        # Numba asks where to keep a function when it is decorated; other packages keep theirs where they did.
        before, config.CACHE_DIR = config.CACHE_DIR, str(cache_folder().path)
        try:
            return njit(cache=True, no_cfunc_wrapper=True, **_COMMON, **options)(function)
        finally:
            config.CACHE_DIR = before

    return decorate


def helper(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator of functions that only compiled code calls."""
    return njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_COMMON, **options)  # type: ignore[no-any-return]


def inlined() -> Callable[[Callable[..., Any]], Any]:
    """Decorator of functions that only compiled code calls, at one place or so small that more do no harm."""
    return njit(inline="always", **_COMMON)  # type: ignore[no-any-return]


@cache
def source_files() -> tuple[Path, ...]:
    """Every file with compiled functions."""
    return tuple(sorted(path for path in _PACKAGE.rglob("_*.py") if "stickslip_ros.compilation" in path.read_text()))


@cache
def cache_folder() -> CacheFolder:
    """In NUMBA_CACHE_DIR if that is set, else beside the sources, else in the user's cache, named by the sources.

    Numba compiles a function anew when its own file has changed, but not when that of a function which it calls has;
    so all of them share a folder, and another one as soon as any of them changes. Where nothing can be written it is
    one that goes with this process; those that it starts find it by NUMBA_CACHE_DIR.
    """
    contents = hashlib.sha256(b"".join(path.read_bytes() for path in source_files())).hexdigest()[:16]
    given = os.environ.get(_GIVEN)
    users = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    for folder in [Path(given).absolute()] if given else [_PACKAGE / "__pycache__", users]:
        if _can_be_written(folder / f"{_NAME}{contents}"):
            return CacheFolder(folder / f"{_NAME}{contents}")
    passing = tempfile.mkdtemp(prefix=_NAME)
    for at_end in (atexit.register, at_hard_end):
        at_end(partial(shutil.rmtree, passing, ignore_errors=True))
    os.environ[_GIVEN] = passing
    return CacheFolder(Path(passing) / f"{_NAME}{contents}", permanent=False)


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def without_linear_algebra() -> None:
    """For processes that are ours alone: let numba do without BLAS and LAPACK, which no kernel uses.

    To offer them it loads scipy.linalg with its first function, half a second and 16 MB.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules:
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        del sys.modules[name]


def marker() -> Path:
    """The file that is there once everything is compiled: these sources by this Python and numba for this processor."""
    about = [
        sys.version, numba.__version__, llvmlite.__version__,
        config.CPU_NAME or binding.get_host_cpu_name(),
        config.CPU_FEATURES or binding.get_host_cpu_features().flatten(),
        *(f"{path} {path.stat().st_mtime_ns}" for path in source_files()),
    ]  # fmt: skip
    return cache_folder().path / f"compiled-{hashlib.sha256(chr(10).join(about).encode()).hexdigest()[:16]}"


def forget_earlier_sources() -> None:
    """Remove what the sources beside this file were compiled to before they changed."""
    folder = cache_folder().path
    if folder.parent == _PACKAGE / "__pycache__":
        for other in folder.parent.glob(f"{_NAME}*"):
            if other != folder:
                shutil.rmtree(other, ignore_errors=True)
