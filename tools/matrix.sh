#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
# Installation, demo, and the tests of what differs between Pythons and libraries, on every Python that is there, each
# with the newest libraries; once with those of Ubuntu Noble, and once on ROS 2 Kilted. Arguments: the legs to run, of
# those below.
set -u
cd "$(dirname "$0")/.."
legs="${*:-3.10 3.11 3.12 3.13 noble kilted}"
# Noble's numba is made for Python 3.12; the one from wheels goes to 3.11.
noble="numpy==1.26.4 scipy==1.11.4 numba==0.58.1"
tests="test/test_warm_up.py::test_two_started_where_not_all_is_compiled test/test_plain_data.py test/test_parameter_names.py test/nodes/test_conversion.py
    test/nodes/test_slow_work.py test/nodes/test_state_over_dds.py test/nodes/test_lifecycle_over_dds.py test/bags/test_reading.py
    test/cli/test_margin_command.py"
folder="$PWD/.matrix"
export NUMBA_CACHE_DIR ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST

interpreter() {
    for candidate in "python$1" "$HOME/.pyenv/versions/$1".*/bin/python3; do
        "$candidate" -c "import sys; sys.exit('%d.%d' % sys.version_info[:2] != '$1')" 2>/dev/null &&
            { echo "$candidate"; return; }
    done
}

leg() {
    python="$1"; name="$2"; ros="$3"; shift 3
    "$python" -m venv --clear "$folder/$name" || return
    bin="$folder/$name/bin"
    NUMBA_CACHE_DIR="$folder/$name/cache"
    "$bin/python" -m pip install --quiet --upgrade pip "setuptools<80" wheel || return
    # Not editable, so that what setup.py leaves out is missed; nor made of what an earlier build left.
    rm -rf build
    "$bin/python" -m pip install --quiet --no-build-isolation ".[$ros]" pytest hypothesis mcap-ros2-support \
        catkin-pkg "$@" || return
    "$bin/python" -c 'import numpy, scipy, numba, sys
print("Python", sys.version.split()[0], "numpy", numpy.__version__, "scipy", scipy.__version__, "numba", numba.__version__)'
    (cd "$folder/$name" && "$bin/stickslip" warm-up && timeout 300 "$bin/stickslip" demo) || return
    # Not `python -m pytest`, nor from here: the sources would come before the package that was installed, in the tests
    # or in the nodes that they start, and would be compiled once more.
    # shellcheck disable=SC2046,SC2086
    (cd "$folder/$name" && timeout 900 "$bin/pytest" $(printf "../../%s " $tests))
}

failed=""; missing=""; passed=""
for name in $legs; do
    version="$name"; libraries=""; ros=ros
    [ "$name" = noble ] && { version=3.11; libraries="$noble"; }
    # Its wheels are made for this Python.
    [ "$name" = kilted ] && { version=3.12; ros=kilted; }
    found="$(interpreter "$version")"
    if [ -z "$found" ]; then
        missing="$missing $name"
        continue
    fi
    echo "== $name: $found"
    # shellcheck disable=SC2086
    if leg "$found" "$name" "$ros" $libraries; then passed="$passed $name"; else failed="$failed $name"; fi
done
echo "matrix: passed:${passed:- none}; failed:${failed:- none}; no such Python here:${missing:- none}"
[ -z "$failed" ] && [ -n "$passed" ]
