"""Find or make the study of a folder of images: time a run of nominal, plan by the minutes, queue the first trials."""

import hashlib
import itertools
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gtf_tune.definition import SequenceDefinition, StudyDefinition
from gtf_tune.definition.model import name_from
from gtf_tune.errors import RunError
from gtf_tune.pipelines import Pipeline
from gtf_tune.pipelines.preset_spaces import DEFAULT_TIER, preset_pipelines, preset_search, preset_space
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence, say_notes
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study
from gtf_tune.store.trials import Trial
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import OpenStudy, load_defined_sequence, make_pipeline
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.tune.budget import CLEAN_RUNS, MOST_TRIALS, NOISY_RUNS, Budget, Plan, Reduction, RunPrice
from gtf_tune.study.tune.handover import Configurations, scaled_to

TUNE_KEY = "tune"
"""Where the resolved part of a study keeps what this command planned."""

NOISE_SIGMA = 0.5
"""Noise in grey levels: what measuring it, for 14 to 30 runs, gave on nearly every sequence (docs/results.md)."""

_SHORT_S = 15.0
_FEWEST_REDUCED_FRAMES = 10
_SMALLEST_IMAGE = 320


@dataclass(frozen=True)
class TuneRequest:
    """What is to be tuned, and how long it may take.

    ``sections`` are parts of a study definition that are given by hand (``pipeline``, ``space``, ``sequences`` ...);
    what they leave open comes from the preset of the pipeline. ``minutes`` is the whole wall time. ``start`` is a
    configuration to try before all others.
    """

    source: Path
    minutes: float
    jobs: int
    tier: int = DEFAULT_TIER
    sections: Mapping[str, Any] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)

    @property
    def pipeline(self) -> str:
        """Name of the pipeline."""
        return str(self.sections.get("pipeline", {}).get("name", "glomap"))

    @property
    def identity(self) -> dict[str, Any]:
        """What makes two requests the same study; the minutes are not part of it."""
        given = [self.tier, self.sections, *([self.start] if self.start else [])]
        parts = json.dumps(given, sort_keys=True, default=str)
        return {"source": str(self.source.absolute()), "request": hashlib.sha256(parts.encode()).hexdigest()}


@dataclass(frozen=True)
class Tuning:
    """A study and what was planned for it."""

    study: Study
    plan: Plan

    @property
    def name(self) -> str:
        """Name of the study."""
        return self.study.name


def known_tuning(database: Database, request: TuneRequest) -> Tuning | None:
    """Return the newest study that an equal request began; None where there is none."""
    for name in reversed(studies.names(database)):
        study = studies.get(database, name)
        stored = study.resolved.get(TUNE_KEY)
        if stored and {key: stored.get(key) for key in request.identity} == request.identity:
            return Tuning(study, _plan_from(stored["plan"]))
    return None


def begin_tuning(
    database: Database, request: TuneRequest, source: RunSource, announce: Callable[[str], None]
) -> Tuning:
    """Time a run of nominal, plan by the minutes, create the study and queue its first trials.

    Raises
    ------
    GtfTuneError
        The images cannot be read, nothing says what to search, or nominal does not work.
    """
    root = request.source.absolute().parent
    definition = _definition(request, _free_name(database, request))
    pipeline, first = make_pipeline(definition), definition.search.first
    most = definition.search.trials or MOST_TRIALS
    budget = Budget(60 * request.minutes, request.jobs, len(first), len(definition.search.baselines), most)
    given = definition.sequences[0].model_dump(mode="json")
    whole = load_defined_sequence(definition.sequences[0], root, pipeline)
    say_notes(whole, announce)
    full = _price(definition, pipeline, whole, source)
    announce(f"a run with the nominal options takes {full.whole_s:.0f} s, its last stage {full.repeated_s:.0f} s")
    budget = replace(budget, seconds=budget.seconds - full.whole_s)
    plan = budget.plan(full)
    if plan.reduction != Reduction():
        selection = _selection(whole, definition.sequences[0], plan.reduction)
        definition = _definition(request, definition.name, selection=selection)
        reduced = load_defined_sequence(definition.sequences[0], root, pipeline)
        announce(
            f"{request.minutes:g} minutes buy too little on all of it: the search uses {len(reduced)} images of "
            f"{reduced.width}x{reduced.height} pixels"
        )
        plan = budget.plan(full, _price(definition, pipeline, reduced, source), plan.reduction)
    searched = definition.search.model_copy(update={"trials": plan.trials - len(first)})
    resolved = {TUNE_KEY: {**request.identity, "minutes": request.minutes, "plan": asdict(plan), "whole": given}}
    study = create_study(database, definition.model_copy(update={"search": searched}), root, resolved=resolved)
    return Tuning(studies.get(database, study.name), plan)


def whole_sequence(study: OpenStudy) -> Sequence:
    """Return the first sequence of a study with all frames that were asked for, at full size.

    `gtf-tune tune` may have searched on fewer and smaller images than it was given.

    Raises
    ------
    SequenceError
        The images are gone.
    """
    tuned = study.record.resolved.get(TUNE_KEY)
    if tuned:
        given = SequenceDefinition.model_validate(tuned["whole"])
    else:
        given = study.definition.searched_sequences[0].model_copy(update={"max_image_size": None})
    return load_defined_sequence(given, Path(study.record.root), study.pipeline)


def configurations_of(study: OpenStudy, chosen: Trial | None, whole: Sequence) -> Configurations:
    """Return the configuration of a trial, as the adopted one, and the nominal one, for the whole sequence.

    Without a trial both are nominal. Options in pixels that differ from nominal are scaled where the search ran on
    smaller images.
    """
    fixed, nominal = study.definition.fixed_options, study.space.nominal
    searched = next(iter(study.sequences.values()))
    trial = chosen.options if chosen else None
    defaults = {name: spec.default for name, spec in study.pipeline.options.specs.items()}
    usual = {**defaults, **fixed, **nominal}
    changed = {name: value for name, value in (trial or nominal).items() if value != usual[name]}
    factor = max(whole.width, whole.height) / max(searched.width, searched.height)
    is_baseline = chosen is not None and chosen.number < 0
    pixels = frozenset() if is_baseline else _in_pixels(study.definition.pipeline.name)  # people use it at full size
    adopted = {**nominal, **scaled_to(changed, pixels, factor)}
    both = ({**fixed, **adopted}, {**fixed, **nominal})
    return Configurations(
        *({name: options[name] for name in options if options[name] != defaults[name]} for options in both)
    )


def _in_pixels(pipeline: str) -> frozenset[str]:
    options = preset_space(pipeline).options if pipeline in preset_pipelines() else ()
    return frozenset(option.name for option in options if option.unit == "pixels")


def _definition(
    request: TuneRequest, name: str, selection: Mapping[str, Any] = MappingProxyType({})
) -> StudyDefinition:
    given = request.sections
    space = {**_preset_axes(request), **given.get("space", {})}
    sequences = given.get("sequences") or [{"name": name_from(request.source.stem), "path": request.source.name}]
    search = {**preset_search(request.pipeline, space, given.get("pipeline", {})), **given.get("search", {})}
    if request.start:
        search["first"] = [dict(request.start), *search.get("first", [])]
    runs = {"clean_runs": CLEAN_RUNS, "noisy_runs": NOISY_RUNS, "noise_sigma": NOISE_SIGMA}
    return checked_definition(
        {
            **given,
            "name": name,
            "pipeline": {"name": request.pipeline, **given.get("pipeline", {})},
            "sequences": [{**sequence, **selection} for sequence in sequences],
            "space": space,
            "search": search,
            "gtf": {**runs, **given.get("gtf", {})},
        },
        str(request.source),
        root=request.source.absolute().parent,
    )


def _preset_axes(request: TuneRequest) -> Mapping[str, Any]:
    """Return the axes of the preset; axes given by hand stand alone where the pipeline has none."""
    if request.pipeline not in preset_pipelines() and request.sections.get("space"):
        return {}
    return preset_space(request.pipeline).axes(request.tier)


def _selection(sequence: Sequence, given: SequenceDefinition, reduction: Reduction) -> dict[str, Any]:
    """Return the frames and the size of a reduced search; few frames and small images stay as they are."""
    longer = max(sequence.width, sequence.height)
    stride = min(round(1 / reduction.frames), max(len(sequence) // _FEWEST_REDUCED_FRAMES, 1))
    return {
        "max_image_size": max(round(longer * reduction.size), min(longer, _SMALLEST_IMAGE)),
        "stride": stride * (given.stride or 1),
    }


def _price(definition: StudyDefinition, pipeline: Pipeline, sequence: Sequence, source: RunSource) -> RunPrice:
    """Return what a run costs, from the first run of the nominal trial, which is stored for it.

    The first noisy run is timed as well where that run found stages at hand, or is so short that the start of the
    executor rules it.

    Raises
    ------
    RunError
        The run failed.
    """
    planner = RunPlanner(pipeline, definition.gtf, SeedSource(definition.search.seed), definition.fixed_options)
    clean, noisy = (
        planner.request(sequence, {}, (kind, 0), sigma=_sigma(definition), number=0) for kind in ("clean", "noisy")
    )
    found = _timed(clean, source)
    if found["wall"] < _SHORT_S or any(found[name] for name in found if name.endswith("_cached")):
        other = _timed(noisy, source)
        found = {name: max(found.get(name, 0.0), seconds) for name, seconds in other.items()} | {"wall": other["wall"]}
    stages = {name: seconds for name, seconds in found.items() if name.endswith("_s")}
    whole = max(found["wall"], sum(stages.values()))
    matched = sum(stages.get(f"{stage}_s", 0.0) for stage in ("images", "features", "matches"))
    around = whole - sum(stages.values())  # starting a process and reading its packages
    return RunPrice(whole, stages["mapping_s"] + around if "mapping_s" in stages else whole, whole - matched)


def _sigma(definition: StudyDefinition) -> float:
    return NOISE_SIGMA if isinstance(definition.gtf.noise_sigma, str) else definition.gtf.noise_sigma


def _timed(request: RunRequest, source: RunSource) -> dict[str, float]:
    """Return the times of a run: the ``wall`` time with what surrounds it, and what its pipeline says of its stages."""
    began = time.monotonic()
    run = source.obtain([request])[0]
    if run.stored.error:
        raise RunError(f"the nominal options do not work on '{request.sequence.name}': {run.stored.error}")
    said = {name: float(value) for name, value in run.stored.diagnostics.items() if name.endswith(("_s", "_cached"))}
    return {**said, "wall": run.stored.wall_s if run.reused else time.monotonic() - began}


def _plan_from(stored: Mapping[str, Any]) -> Plan:
    prices = {name: RunPrice(**stored[name]) for name in ("price", "full") if name in stored}
    return Plan(**{**stored, **prices, "reduction": Reduction(**stored["reduction"])})


def _free_name(database: Database, request: TuneRequest) -> str:
    """Return the name of the source, with a number where another study has it."""
    base, taken = str(request.sections.get("name") or name_from(request.source.stem)), set(studies.names(database))
    numbered = (f"{base}-{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain([base], numbered) if name not in taken)
