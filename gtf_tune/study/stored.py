"""Read what is stored with a study, without what it takes to work on it."""

import json

from gtf_tune.definition import StudyDefinition, definition_from_dict
from gtf_tune.errors import DefinitionError
from gtf_tune.store.studies import Study, StudySummary


def stored_definition(record: Study | StudySummary) -> StudyDefinition:
    """Return the definition that is stored with a study.

    Raises
    ------
    DefinitionError
        The stored text is damaged, or a newer version wrote it.
    """
    source = f"study '{record.name}'"
    try:
        data = json.loads(record.definition)
    except ValueError as error:
        raise DefinitionError(f"{source}: its stored definition is damaged; see 'gtf-tune storage check'") from error
    return definition_from_dict(data, source)
