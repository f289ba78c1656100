"""Define a study: the TOML file, its checks, and what every field means."""

from gtf_tune.definition.bounds import bound_faults, refuse_unbounded
from gtf_tune.definition.gtf import GtfDefinition, NoisyRuns, SideMetricDefinition
from gtf_tune.definition.loading import definition_from_dict, dump_definition, load_definition, read_options, read_toml
from gtf_tune.definition.model import (
    DEFAULT_TRIALS,
    Axis,
    LimitsDefinition,
    PipelineDefinition,
    RangeAxis,
    SearchDefinition,
    SequenceDefinition,
    StudyDefinition,
    ValuesAxis,
)

__all__ = [
    "DEFAULT_TRIALS",
    "Axis",
    "GtfDefinition",
    "LimitsDefinition",
    "NoisyRuns",
    "PipelineDefinition",
    "RangeAxis",
    "SearchDefinition",
    "SequenceDefinition",
    "SideMetricDefinition",
    "StudyDefinition",
    "ValuesAxis",
    "bound_faults",
    "definition_from_dict",
    "dump_definition",
    "load_definition",
    "read_options",
    "read_toml",
    "refuse_unbounded",
]
