#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
# The browser in which the tests open the reports: Debian's. Does nothing where it is there already, or where
# packages cannot be installed; the tests then say so.
set -eu
if command -v chromium >/dev/null && command -v chromedriver >/dev/null; then
    exit 0
fi
if ! command -v apt-get >/dev/null || [ "$(id -u)" != 0 ]; then
    echo "tools/install_chromium.sh: no chromium here, and no right to install it: the tests of pages are skipped" >&2
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq || true
apt-get install -y -qq --no-install-recommends chromium chromium-driver >/dev/null
