"""Whether the backend may fetch anything from the network: what the add-on tells it, or the
user.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

OFFLINE_VARIABLE = "FACESTAGE_OFFLINE"


def is_offline(environment: Mapping[str, str] | None = None) -> bool:
    """Whether $FACESTAGE_OFFLINE asks for no downloads: set to anything but 0 or nothing."""
    value = (os.environ if environment is None else environment).get(OFFLINE_VARIABLE, "")
    return value.strip() not in ("", "0")


def with_online_access(environment: Mapping[str, str], allowed: bool) -> dict[str, str]:
    """``environment`` for a backend that may download when ``allowed``; a variable that the user
    set stays.
    """
    return dict(environment) if allowed else {**environment, OFFLINE_VARIABLE: "1"}
