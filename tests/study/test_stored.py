import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.store.studies import Study, stored_definition


def test_a_damaged_definition_is_one_sentence() -> None:
    record = Study(1, "photos", 1, "open", 0.0, "{oops", {}, "/")

    with pytest.raises(DefinitionError, match=r"^study 'photos': its stored definition is damaged; check the storage"):
        stored_definition(record)
