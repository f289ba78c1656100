"""Read what is stored with a study, without what it takes to work on it."""

import json

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.store.studies import Study, StudySummary


def stored_definition(record: Study | StudySummary) -> StudyDefinition:
    """Return the definition that is stored with a study."""
    return definition_from_dict(json.loads(record.definition), f"study '{record.name}'")
