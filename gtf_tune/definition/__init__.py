"""Define a study: the TOML file, its checks, and what every field means."""

from gtf_tune.definition.gtf import GtfDefinition, NoisyRuns
from gtf_tune.definition.loading import definition_from_dict, dump_definition, load_definition, read_toml
from gtf_tune.definition.model import (
    LimitsDefinition,
    PipelineDefinition,
    SequenceDefinition,
    StudyDefinition,
)
from gtf_tune.definition.search import DEFAULT_TRIALS, SearchDefinition
from gtf_tune.definition.side_metric import SideMetricDefinition
from gtf_tune.definition.space import Axis, RangeAxis, ValuesAxis

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
    "definition_from_dict",
    "dump_definition",
    "load_definition",
    "read_toml",
]
