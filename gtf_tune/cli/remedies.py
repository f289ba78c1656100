"""Flags and commands of the command line for what errors advise."""

import shlex
from collections.abc import Mapping
from types import MappingProxyType

from gtf_tune.errors import GtfTuneError

REMEDIES: Mapping[str, str] = MappingProxyType(
    {
        "cache": "--cache-dir FOLDER or --no-cache",
        "cache folder": "--cache-dir FOLDER",
        "cameras": "--cameras auto",
        "check": "gtf-tune storage check",
        "create": "gtf-tune study create ... --storage {0}",
        "delete": "gtf-tune study delete {0}",
        "delete there": "gtf-tune study delete {0} --storage {1}",
        "derive": "gtf-tune study extend {0} --as NEW-NAME and the same flags",
        "executor": "--executor dask://HOST:PORT",
        "extension": "--trials N, --range NAME=LOW:HIGH, or --as NEW-NAME with --noisy-runs N",
        "extract": "gtf-tune sequence extract {0} {1} --rate-hz 3",
        "format": "--format json or --format csv",
        "largest group": "--cameras largest",
        "list": "gtf-tune study list --storage {0}",
        "options": "gtf-tune pipeline options {0}",
        "pause": "gtf-tune study pause {0}",
        "options file": "gtf-tune study export NAME --format json",
        "pipelines": "gtf-tune pipeline list",
        "presets": "gtf-tune pipeline presets {0}",
        "port": "--port N or --host ADDRESS",
        "recursive": "--recursive",
        "resume": "gtf-tune study resume {0}",
        "resume or delete": "gtf-tune study resume {0}, or gtf-tune study delete {0}",
        "run": "gtf-tune study run {0}",
        "runs": "--runs N",
        "sampler": "--sampler NAME",
        "sequence": "--sequence {0}=PATH",
        "show": "gtf-tune study show NAME",
        "show, derive or delete": (
            "gtf-tune study show {0}, gtf-tune study extend {0} --as NEW-NAME, or gtf-tune study delete {0}"
        ),
        "show it": "gtf-tune study show {0}",
        "storage": "--storage URL",
        "trials": "--trials N",
        "upgrade": "gtf-tune storage upgrade --storage {0}",
        "version mismatch": "--allow-version-mismatch",
    }
)
"""Flags and commands by the actions that errors name; numbers in braces stand for the action's arguments."""


def with_remedy(error: GtfTuneError) -> str:
    """Return the message of an error, with the flag or the command that helps."""
    if not error.remedy:
        return str(error)
    action, *arguments = error.remedy
    return f"{error} ({REMEDIES[action].format(*map(shlex.quote, arguments))})"
