"""Find or make the study of a folder of images: time a run of nominal, plan by the minutes, queue the first trials."""

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from gtf_tune.definition import SequenceDefinition, StudyDefinition
from gtf_tune.definition.model import name_from
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.preset_spaces import (
    DEFAULT_TIER,
    preset_pipelines,
    preset_search,
    preset_space,
    searched_options,
)
from gtf_tune.sequence import Sequence
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study
from gtf_tune.store.trials import Trial
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import OpenStudy, load_defined_sequence, make_pipeline
from gtf_tune.study.outcome.confirm import MARGINS_KEY
from gtf_tune.study.outcome.recommendation import Recommendation
from gtf_tune.study.tune.budget import (
    CLEAN_RUNS,
    FEWEST_NOISY_RUNS,
    MOST_TRIALS,
    NOISY_RUNS,
    Budget,
    Plan,
    Reduction,
    RunPrice,
)
from gtf_tune.study.tune.choice import TooLittleTime, choose
from gtf_tune.study.tune.estimate import NOISE_SIGMA, Beginning, Estimate
from gtf_tune.study.tune.handover import Configurations, changed_options, scaled_to

TUNE_KEY = "tune"
"""Where the resolved part of a study keeps what this command planned."""


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
        return pipeline_of(self.sections)

    @property
    def root(self) -> Path:
        """Folder that paths of sequences are relative to."""
        return self.source.absolute().parent

    @property
    def identity(self) -> dict[str, Any]:
        """What makes two requests the same study; the minutes are not part of it."""
        given = [self.tier, self.sections, *([self.start] if self.start else [])]
        parts = json.dumps(given, sort_keys=True, default=str)
        return {"source": str(self.source.absolute()), "request": hashlib.sha256(parts.encode()).hexdigest()}


def pipeline_of(sections: Mapping[str, Any]) -> str:
    """Return the name of the pipeline that parts of a definition ask for."""
    return str(sections.get("pipeline", {}).get("name", "glomap"))


def tier_of(preset: str, sections: Mapping[str, Any]) -> int:
    """Return the tier of a preset of the pipeline that parts of a definition ask for.

    Raises
    ------
    DefinitionError
        The pipeline has no such preset.
    """
    pipeline = pipeline_of(sections)
    return preset_space(pipeline).tier(preset) if pipeline in preset_pipelines() else DEFAULT_TIER


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


def begin_tuning(database: Database, request: TuneRequest, means: Beginning) -> Tuning | TooLittleTime:
    """Time runs of nominal, hand its model over, plan by the minutes, create the study and queue its first trials.

    Where the minutes buy no comparison, the nominal model is all there is, and no study is created.

    Raises
    ------
    GtfTuneError
        The images cannot be read, nothing says what to search, or nominal does not work.
    """
    root = request.root
    definition = _definition(request, _free_name(database, request))
    pipeline, first = make_pipeline(definition), definition.search.first
    estimate = Estimate(definition, pipeline, root, means, 60 * request.minutes)
    models, full = estimate.models()
    chosen = choose(estimate, full, _budget(request, definition), means.left_s)
    if isinstance(chosen, TooLittleTime):
        return chosen
    plan, definition = chosen, estimate.reduced(chosen.reduction)
    if plan.reduction != Reduction():
        means.announce(
            f"{round(request.minutes, 1):g} minutes buy too little on all of it: the search uses "
            f"{estimate.shown(plan.reduction)}"
        )
    # The first configurations are queued in any case; where there is no time for all of them the clock ends the search.
    searched = definition.search.model_copy(update={"trials": max(plan.trials - len(first), 1)})
    scored = definition.gtf.model_copy(update={"noisy_runs": plan.noisy} if _may_shorten(request) else {})
    stored = {"minutes": request.minutes, "plan": asdict(plan), "whole": estimate.whole_given, "models": models}
    study = create_study(
        database,
        definition.model_copy(update={"search": searched, "gtf": scored}),
        root,
        resolved={TUNE_KEY: {**request.identity, **stored}, **_margins(definition)},
    )
    return Tuning(studies.get(database, study.name), plan)


def _budget(request: TuneRequest, definition: StudyDefinition) -> Budget:
    """Return the whole time, and what a trial and a confirmation are made of."""
    search, gtf = definition.search, definition.gtf
    return Budget(
        60 * request.minutes,
        request.jobs,
        len(search.first),
        len(search.baselines),
        most_trials=search.trials or MOST_TRIALS,
        noisy=gtf.noisy_runs_max,
        clean=gtf.clean_runs,
        fewest_noisy=FEWEST_NOISY_RUNS if _may_shorten(request) else gtf.noisy_runs_max,
    )


def _may_shorten(request: TuneRequest) -> bool:
    """Whether trials may have fewer noisy runs; not where someone said how many."""
    return "noisy_runs" not in request.sections.get("gtf", {})


def whole_sequence(study: OpenStudy, part: Literal["whole", "models"] = "whole") -> Sequence:
    """Return the first sequence of a study with all frames that were asked for, at full size.

    `gtf-tune tune` may have searched on fewer and smaller images than it was given, and may have made its ``models`` of
    such ones.

    Raises
    ------
    SequenceError
        The images are gone.
    """
    tuned = study.record.resolved.get(TUNE_KEY)
    if tuned:
        given = SequenceDefinition.model_validate(tuned.get(part, tuned["whole"]))
    else:
        given = study.definition.searched_sequences[0].model_copy(update={"max_image_size": None})
    return load_defined_sequence(given, Path(study.record.root), study.pipeline)


def configurations_of(study: OpenStudy, chosen: Trial | None, whole: Sequence, label: str = "") -> Configurations:
    """Return the configuration of a trial, as the adopted one, and the nominal one, for the whole sequence.

    Without a trial both are nominal. Options in pixels that differ from nominal are scaled where the search ran on
    smaller images than those that are stored; COLMAP counts in pixels of these, however it reduces them.
    """
    fixed, nominal = study.definition.fixed_options, study.space.nominal
    searched = next(iter(study.sequences.values()))
    trial = chosen.options if chosen else None
    defaults = {name: spec.default for name, spec in study.pipeline.options.specs.items()}
    usual = {**defaults, **fixed, **nominal}
    changed = {name: value for name, value in (trial or nominal).items() if value != usual[name]}
    factor = max(max(camera.stored_size) for camera in whole.cameras) / searched.longest_side
    is_baseline = chosen is not None and chosen.number < 0
    pixels = frozenset() if is_baseline else _in_pixels(study.definition.pipeline.name)  # people use it at full size
    adopted = {**nominal, **scaled_to(changed, pixels, factor)}
    both = [changed_options(study.pipeline, {**fixed, **options}) for options in (adopted, nominal)]
    return Configurations(both[0], both[1], label=label)


def recommended(study: OpenStudy, found: Recommendation, whole: Sequence) -> Configurations:
    """Return the configurations that a recommendation leads to: only what was adopted takes the place of nominal."""
    configurations = configurations_of(study, found.trial, whole)
    if found.decision == "adopt":
        return replace(configurations, label=f"ADOPTED options, confirmed on fresh noise. {found.text}")
    nominal = replace(configurations, adopted=configurations.nominal, label=f"NOMINAL options. {found.text}")
    if found.decision != "unconfirmed" or configurations.adopted == configurations.nominal:
        return nominal
    return replace(nominal, unconfirmed=configurations.adopted)


def _margins(definition: StudyDefinition) -> dict[str, dict[str, float]]:
    """Return what the confirmation asks of options beyond the mapper's, for the resolved part of a study."""
    pipeline = definition.pipeline.name
    found = preset_space(pipeline).margins(definition.space) if pipeline in preset_pipelines() else {}
    return {MARGINS_KEY: found} if found else {}


def _in_pixels(pipeline: str) -> frozenset[str]:
    return frozenset(name for name, option in searched_options(pipeline).items() if option.unit == "pixels")


def _definition(request: TuneRequest, name: str) -> StudyDefinition:
    given = request.sections
    space = {**_preset_axes(request), **given.get("space", {})}
    search = {**preset_search(request.pipeline, space, given.get("pipeline", {})), **given.get("search", {})}
    if request.start:
        search["first"] = [dict(request.start), *search.get("first", [])]
    runs = {"clean_runs": CLEAN_RUNS, "noisy_runs": NOISY_RUNS, "noise_sigma": NOISE_SIGMA}
    return checked_definition(
        {
            **given,
            "name": name,
            "pipeline": {"name": request.pipeline, **given.get("pipeline", {})},
            "sequences": _sequences(request),
            "space": space,
            "search": search,
            "gtf": {**runs, **given.get("gtf", {})},
        },
        str(request.source),
        root=request.root,
    )


def _preset_axes(request: TuneRequest) -> Mapping[str, Any]:
    """Return the axes of the preset; axes given by hand stand alone where the pipeline has none."""
    if request.pipeline not in preset_pipelines() and request.sections.get("space"):
        return {}
    preset = preset_space(request.pipeline)
    if not preset.depends_on_intrinsics(request.tier):
        return preset.axes(request.tier)
    section = request.sections.get("pipeline", {})
    pipeline = create_pipeline(request.pipeline, section.get("settings", {}))
    used = load_defined_sequence(SequenceDefinition.model_validate(_sequences(request)[0]), request.root, pipeline)
    return preset.axes(request.tier, unknown_intrinsics=any(camera.intrinsics is None for camera in used.cameras))


def _sequences(request: TuneRequest) -> list[Mapping[str, Any]]:
    """Return the sequences as a definition has them: those given by hand, else the source."""
    source = {"name": name_from(request.source.stem), "path": request.source.name}
    return list(request.sections.get("sequences") or [source])


def _plan_from(stored: Mapping[str, Any]) -> Plan:
    prices = {name: RunPrice(**stored[name]) for name in ("price", "full") if name in stored}
    return Plan(**{**stored, **prices, "reduction": Reduction(**stored["reduction"])})


def _free_name(database: Database, request: TuneRequest) -> str:
    """Return the name of the source, with a number where another study has it."""
    base, taken = str(request.sections.get("name") or name_from(request.source.stem)), set(studies.names(database))
    numbered = (f"{base}-{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain([base], numbered) if name not in taken)
