"""Name the verdicts of a confirmation, for those who only read them."""

from collections.abc import Mapping
from typing import Any

ADOPT = "adopt"
KEEP = "keep nominal"
NO_VERDICT = "none"
"""Nominal did not work, so there was nothing to compare with."""


def compared(result: Mapping[str, Any], options: Mapping[str, Any] | None) -> bool:
    """Tell whether a confirmation, by its result, compared the setting of these options, nominal or a candidate.

    Options count, not trials: with noise of its own for every trial the same setting may come again and score better.
    """
    settings = [result.get("nominal"), *(result.get("candidates") or ())]
    return any(one.get("options") == options for one in settings if one)
