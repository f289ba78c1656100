"""Prefer the configuration that was best on most measured sequences, unless another trial clearly beats its score."""

import math
from collections.abc import Mapping
from typing import Any

from gtf_tune.store.trials import Trial

LEAD_KEY = "lead"
"""Where the resolved part of a study keeps the ``number`` of its leading trial, and the ``margin`` to beat it by."""


def led(best: Trial | None, leader: Trial | None, nominal: Trial | None, lead: Mapping[str, Any]) -> Trial | None:
    """Return the trial to look at first: the leader, unless the ``best`` score is smaller by the margin.

    A leader that is not feasible or not better than nominal leads nothing. `docs/bank.md` compares this rule, the race
    with a lead, with the smallest score and with the leader alone.
    """
    if best is None or best.value is None or leader is None or leader.value is None:
        return best
    if leader.state != "complete" or not leader.feasible or not _beats(leader, nominal):
        return best
    return best if handicapped(best, lead) < handicapped(leader, lead) else leader


def handicapped(trial: Trial, lead: Mapping[str, Any]) -> float:
    """Return the score by which a trial is ranked: that of the leading one is smaller by the margin."""
    value = math.inf if trial.value is None else trial.value
    return (1 - float(lead["margin"])) * value if trial.number == lead.get("number") else value


def _beats(leader: Trial, nominal: Trial | None) -> bool:
    if nominal is None or nominal.value is None or not nominal.feasible:
        return True
    return leader.value is not None and leader.value < nominal.value
