#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
# Says in one line what this machine lacks. Argument: the Python to use.
python="$1"
lacks() { echo "stickslip_ros: $1" >&2; exit 1; }

[ "$(uname -s)-$(uname -m)" = "Linux-x86_64" ] ||
    lacks "the ROS 2 wheels are for Linux x86-64; this is $(uname -s) $(uname -m). On a ROS 2 Jazzy machine use colcon instead."
command -v "$python" >/dev/null 2>&1 ||
    lacks "needs Python 3.10 to 3.13; there is no $python (choose one with: make PYTHON=python3.12 ...)."
"$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' ||
    lacks "needs Python 3.10 to 3.13; $python is $("$python" -V 2>&1) (choose one with: make PYTHON=python3.12 ...)."
"$python" -c 'import ensurepip, venv' 2>/dev/null ||
    lacks "needs Python's venv module (Debian and Ubuntu: apt install python3-venv)."
