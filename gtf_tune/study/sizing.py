"""Decide how many noisy runs a trial gets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from gtf_tune.definition import GtfDefinition


@dataclass(frozen=True)
class Standing:
    """Hold how a trial stands so far: its instance values in order, and those of the best trial before it.

    Values are positive scores of noisy instances, paired by position because all trials share the noise. ``incumbent``
    is empty while there is no other trial to compare with.
    """

    own: Sequence[float]
    incumbent: Sequence[float]


@dataclass(frozen=True)
class Decision:
    """Say how many noisy runs the trial should have in all, and why it stops where it does."""

    noisy_runs: int
    reason: str = ""


class Sizing(Protocol):
    """Decide the number of noisy runs of trials."""

    def first(self, *, is_nominal: bool) -> int:
        """Return how many noisy runs a trial starts with."""
        ...

    def next(self, standing: Standing) -> Decision:
        """Return how many noisy runs the trial should have; as many as it has means stop."""
        ...


@dataclass(frozen=True)
class FixedSizing:
    """Give every trial the same number of noisy runs: the paper's k_delta."""

    noisy_runs: int

    def first(self, *, is_nominal: bool) -> int:
        """Return k_delta."""
        del is_nominal
        return self.noisy_runs

    def next(self, standing: Standing) -> Decision:
        """Stop."""
        return Decision(len(standing.own))


def sizing_of(gtf: GtfDefinition) -> Sizing:
    """Return the sizing that a definition asks for."""
    return FixedSizing(gtf.noisy_runs_max)
