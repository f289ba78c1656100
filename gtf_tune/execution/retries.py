"""Say which failed runs are tried again, and what a failure means in the end."""

import signal
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from gtf_tune.pipelines.run import FailureCause, RunOutcome

_TRIES = MappingProxyType({"configuration": 1, "unknown": 2, "machine": 2, "killed": 3, "terminated": 3})
_FROM_OUTSIDE = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)


def cause_of_death(number: int) -> FailureCause:
    """Return what the end of a process by a signal says about its run; 0 is no signal."""
    if number == signal.SIGKILL:
        return "killed"
    return "terminated" if number in _FROM_OUTSIDE else "unknown"


@dataclass
class Retries:
    """The attempts that one run has had."""

    causes: list[FailureCause] = field(default_factory=list)

    def wanted(self, outcome: RunOutcome) -> bool:
        """Note how an attempt ended, and return whether another one is due."""
        if outcome.status == "ok":
            return False
        self.causes.append(outcome.cause)
        return self.causes.count(outcome.cause) < _TRIES[outcome.cause]

    def settled(self, outcome: RunOutcome) -> RunOutcome:
        """Return the last outcome with the number of attempts and what its failure means.

        What happened again without a sign that the machine was at fault is due to the configuration. SIGKILL is how
        systems take memory back, and the last attempt had all of it; other signals come from people and schedulers.
        """
        earlier = len(self.causes) - (outcome.status != "ok")
        of_machine = outcome.cause in ("machine", "terminated")
        return replace(outcome, attempts=earlier + outcome.attempts, cause="machine" if of_machine else "configuration")
