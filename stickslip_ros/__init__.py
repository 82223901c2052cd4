# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Online stick-slip monitoring after Armstrong-Hélouvry (1993).

Three floors, imports only go down: ``nodes``, ``bags`` and ``cli`` (the edges), ``monitoring``
(samples to cycles, margin and advice), ``model`` (the physics).
"""

__version__ = "0.1.0"
