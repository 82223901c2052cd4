#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
# Debian packages that tests need: the browser in which they open the reports, and iproute2 to cut a network of their
# own. Does nothing where they are there already, or where packages cannot be installed; the tests then say so.
set -eu
missing=""
command -v chromium >/dev/null && command -v chromedriver >/dev/null || missing="chromium chromium-driver"
command -v ip >/dev/null || missing="$missing iproute2"
if [ -z "$missing" ]; then
    exit 0
fi
if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
    echo "$0: no right to install $missing: the tests that need them are skipped" >&2
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq || true
# shellcheck disable=SC2086
apt-get install -y -qq --no-install-recommends $missing >/dev/null
