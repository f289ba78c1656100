"""Every option of the COLMAP pipelines says what it means."""

import pytest

from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.colmap.option_notes import option_notes

PIPELINES = ("glomap", "colmap", "colmap-hierarchical")


@pytest.mark.parametrize("pipeline", PIPELINES)
def test_no_option_is_without_a_description(pipeline: str) -> None:
    specs = create_pipeline(pipeline).options.specs.values()

    assert [spec.name for spec in specs if not spec.documentation] == []


def test_every_note_belongs_to_an_option() -> None:
    names = {name for pipeline in PIPELINES for name in create_pipeline(pipeline).options.specs}
    names |= set(create_pipeline("glomap", {"pairing": "sequential"}).options.specs)
    solver = {name.rpartition("solver_options.")[2] for name in names if "solver_options." in name}

    assert set(option_notes()["options"]) <= names
    assert set(option_notes()["solver_options"]) <= solver
