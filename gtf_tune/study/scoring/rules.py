"""Keep the scores of one study comparable: whoever works on it must score by the rules that it began with."""

from gtf_tune.errors import DefinitionError
from gtf_tune.store.studies import Study

SCORING_VERSION = 1
"""Version of the rules that turn runs into scores; to be raised whenever the same runs may score differently."""

RESOLVED_KEY = "scoring_version"


def check_rules(study: Study) -> None:
    """Raise `DefinitionError` unless the study is scored by the rules of this version.

    Raises
    ------
    DefinitionError
        The study began with other rules.
    """
    began_with = study.resolved.get(RESOLVED_KEY, 1)
    if began_with != SCORING_VERSION:
        made_by = study.resolved["versions"].get("gtf_tune", "another version")
        raise DefinitionError(
            f"study '{study.name}' is scored by rules of version {began_with}, which gtf-tune {made_by} has, but this "
            f"one scores by version {SCORING_VERSION}; work on it with that gtf-tune, or create a new study"
        )
