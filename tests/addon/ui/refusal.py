"""What a user's error looks like to a script."""

from __future__ import annotations

from collections.abc import Callable

import pytest


def refused(operator: Callable[..., set[str]], match: str, **options: object) -> None:
    """In a script an operator's error report is a RuntimeError with its sentence."""
    with pytest.raises(RuntimeError, match=match) as caught:
        operator(**options)
    assert "Traceback" not in str(caught.value)
