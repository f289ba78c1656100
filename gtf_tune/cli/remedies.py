"""Say how the command line does what an error advises: with which flag, or which command."""

from collections.abc import Mapping
from types import MappingProxyType

from gtf_tune.errors import GtfTuneError

REMEDIES: Mapping[str, str] = MappingProxyType(
    {
        "sampler": "--sampler NAME",
    }
)
"""Flags and commands by the actions that errors name; braces stand for the action's arguments."""


def with_remedy(error: GtfTuneError) -> str:
    """Return the message of an error, with the flag or the command that helps."""
    if not error.remedy:
        return str(error)
    action, *arguments = error.remedy
    return f"{error} ({REMEDIES[action].format(*arguments)})"
