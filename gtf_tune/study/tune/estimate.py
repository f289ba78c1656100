"""Estimate what runs cost, on few small images first, and make the nominal model, the first outcome of tuning."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from gtf_tune.definition import SequenceDefinition, StudyDefinition
from gtf_tune.display import count
from gtf_tune.errors import RunError
from gtf_tune.metrics import AteSettings, pairwise_matrix
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence, say_notes
from gtf_tune.study.open_study import load_defined_sequence
from gtf_tune.study.runs.plan import MAPPING, STAGES, RunPlanner, SeedSource, option_costs
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.search.space import build_space
from gtf_tune.study.tune.budget import REDUCTIONS, Reduction, RunPrice
from gtf_tune.study.tune.handover import (
    Configurations,
    changed_options,
    hand_over,
    hand_over_trajectories,
    makes_models,
)
from gtf_tune.study.tune.reconstruct import TooSlow, Workshop
from gtf_tune.trajectory import Trajectory

NOISE_SIGMA = 0.5
"""Noise in grey levels: what the ladder, of 14 to 30 runs, gave on nearly every sequence (docs/results-appendix.md)."""

_SHORT_S = 15.0
_MODEL_SHARE = 0.4
"""Part of the time that the nominal reconstruction may be expected to take, ..."""
_OVERRUN = 1.4
"""... and how many times as long it may take in the end."""
_SO_FAR = "NOMINAL options (tuning has not ended)."
_GOOD_COVERAGE = 0.9
_MISLEADING = 0.1
"""How far, as a fraction of the extent, nominal on reduced images may be from its model."""
_PRICE_EXPONENT = 1.0
"""With what power of the number of pixels times of runs grow, where one size is measured only."""
_FEWEST_REDUCED_FRAMES = 10
_SMALLEST_IMAGE = 320


@dataclass(frozen=True)
class Beginning:
    """What timing and planning work with: runs, the folder of the outcome, and the seconds that are left."""

    source: RunSource
    folder: Path
    left_s: Callable[[], float]
    announce: Callable[[str], None]


@dataclass
class Estimate:
    """Prices of runs, measured on few small images first, and the nominal model as the first outcome."""

    definition: StudyDefinition
    pipeline: Pipeline
    root: Path
    means: Beginning
    seconds: float
    _measured: dict[Reduction, RunPrice] = field(default_factory=dict)
    _guessed: dict[Reduction, RunPrice] = field(default_factory=dict)
    _clean: dict[Reduction, Trajectory] = field(default_factory=dict)
    _stored: dict[Reduction, int] = field(default_factory=dict)
    _loaded: dict[Reduction, Sequence] = field(default_factory=dict)
    _model: Trajectory | None = None
    of_model: Reduction = REDUCTIONS[0]

    @cached_property
    def whole(self) -> Sequence:
        """All images at full size."""
        return load_defined_sequence(self.definition.sequences[0], self.root, self.pipeline)

    @property
    def whole_given(self) -> dict[str, Any]:
        """All images, as the definition names them."""
        return self.definition.sequences[0].model_dump(mode="json")

    def reduced(self, reduction: Reduction) -> StudyDefinition:
        """Return the definition on fewer and smaller images."""
        given = self.definition.sequences[0]
        selection = _selection(self.whole, given, reduction) if reduction != Reduction() else {}
        changed = SequenceDefinition.model_validate({**given.model_dump(), **selection})
        return self.definition.model_copy(update={"sequences": [changed, *self.definition.sequences[1:]]})

    def sequence(self, reduction: Reduction) -> Sequence:
        """Return the images that a search on fewer and smaller ones uses."""
        if reduction == Reduction():
            return self.whole
        if reduction not in self._loaded:
            given = self.reduced(reduction).sequences[0]
            self._loaded[reduction] = load_defined_sequence(given, self.root, self.pipeline)
        return self._loaded[reduction]

    @property
    def reductions(self) -> tuple[Reduction, ...]:
        """Return the reductions that leave different images, the weakest first; of equal ones the weakest."""
        found: dict[str, Reduction] = {}
        for reduction in REDUCTIONS:
            found.setdefault(self.shown(reduction), reduction)
        return tuple(found.values())

    def stored(self, reduction: Reduction) -> int:
        """Return how many runs of the nominal trial there are stored already."""
        return self._stored.get(reduction, 0)

    def models(self) -> tuple[dict[str, Any], RunPrice]:
        """Return of which images models are made, and what they cost; the nominal one is handed over here.

        Images that would take too large a part of the time are reduced.
        """
        self.means.announce(f"inspect: {self._found}; pipeline {self.pipeline.name}")
        say_notes(self.whole, self.means.announce)
        if not makes_models(self.pipeline.name):
            price = replace(self.measured(Reduction()), repeated_s=0.0)
            self._hand_over_trajectory()
            return self.whole_given, price
        pilot = self._pilot()
        shares = [(reduction, _MODEL_SHARE * self.seconds) for reduction in (Reduction(), pilot)]
        for reduction, limit_s in shares:
            if reduction == pilot or self.price(reduction).whole_s <= limit_s:
                given = self.reduced(reduction).sequences[0].model_dump(mode="json")
                most_s = self.means.left_s() if reduction == pilot else _OVERRUN * limit_s
                try:
                    return given, self._hand_over_nominal(reduction, most_s)
                except TooSlow:
                    if reduction == pilot:
                        raise
            self.means.announce(
                f"two reconstructions of all {len(self.whole)} images at full size take too large a part of the time; "
                "the models are made of fewer and smaller ones; give more minutes for all of it"
            )
        raise AssertionError("the pilot returns or raises")

    def measured(self, reduction: Reduction) -> RunPrice:
        """Return what a run of nominal costs there; it is stored for the nominal trial."""
        if reduction not in self._measured:
            used = self.sequence(reduction)
            self.means.announce(f"estimate: timing a run with the nominal options on {self.shown(reduction)}")
            stage_s, clean, self._stored[reduction] = _timed_stages(
                self.definition, self.pipeline, used, self.means.source, len(self.whole)
            )
            price = price_of_stages(stage_s, _earliest_stage(self.definition, self.pipeline))
            self._measured[reduction], self._clean[reduction] = price, clean
            self.means.announce(
                f"a run with the nominal options on {self.shown(reduction)} takes {price.whole_s:.0f} s, what a "
                f"configuration repeats of it {price.repeated_s:.0f} s"
            )
            if len(self._measured) == 1:
                for cost in option_costs(_stage_of(self.definition, self.pipeline), stage_s):
                    self.means.announce(cost)
        return self._measured[reduction]

    def misleads(self, reduction: Reduction) -> bool:
        """Whether nominal gives another trajectory on these images than in its model: no search can use them then."""
        if self._model is None or reduction == self.of_model:
            return False
        try:
            self.measured(reduction)
        except RunError as error:
            self.means.announce(str(error))
            return True
        moved, found = _differ(self._model, self._clean[reduction]), len(self._clean[reduction])
        if found >= _GOOD_COVERAGE * len(self.sequence(reduction)) and moved < _MISLEADING:
            return False
        self.means.announce(
            f"{self.shown(reduction)} are too few or too small: {found} are registered, and the nominal trajectory is "
            f"{'another one' if math.isnan(moved) else f'off by {moved:.0%} of its extent'}"
        )
        return True

    def price(self, reduction: Reduction) -> RunPrice:
        """Return the price there as far as it is known, else estimated by the number of pixels."""
        if reduction in self._measured:
            return self._measured[reduction]
        known = [(self._pixels(other), price) for other, price in {**self._guessed, **self._measured}.items()]
        known.sort(key=lambda pair: pair[0])
        (few, low), pixels = known[0], self._pixels(reduction)
        if len(known) == 1:
            return low.times((pixels / few) ** _PRICE_EXPONENT)
        most, high = known[-1]
        return low.between(high, math.log(pixels / few) / math.log(most / few)) if most > few else low

    @property
    def _found(self) -> str:
        """All images in words: how many, how large, by which cameras, and whether their intrinsics are known."""
        whole = self.whole
        sizes = dict.fromkeys(f"{width}x{height}" for width, height in (camera.size for camera in whole.cameras))
        known = all(camera.intrinsics is not None for camera in whole.cameras)
        taken_by = f"{count(len(whole.cameras), 'camera')} with {'known' if known else 'unknown'} intrinsics"
        return f"{count(len(whole), 'image')} of {' and '.join(sizes)} pixels, {taken_by}"

    def shown(self, reduction: Reduction) -> str:
        """Return how many images of which size a reduction leaves."""
        used = self.sequence(reduction)
        return f"{len(used)} images of {used.width}x{used.height} pixels"

    def _pixels(self, reduction: Reduction) -> int:
        used = self.sequence(reduction)
        return sum(math.prod(used.camera_of(frame).size) for frame in used.frames)

    def _pilot(self) -> Reduction:
        """Return the strongest reduction on which nominal works, with its price measured."""
        for reduction in reversed(self.reductions):
            try:
                self.measured(reduction)
            except RunError:
                if reduction == Reduction():
                    raise
            else:
                return reduction
        raise AssertionError("the last of them is no reduction")

    def _hand_over_trajectory(self) -> None:
        """Hand over the nominal trajectory of a pipeline that makes no model."""
        configurations = Configurations(self._nominal, self._nominal, label=_SO_FAR)
        clean = self._clean[Reduction()]
        hand_over_trajectories(self.means.folder, configurations, {"nominal": clean, "adopted": clean})

    @property
    def _nominal(self) -> dict[str, OptionValue]:
        space = build_space(self.definition, self.pipeline.options)
        return changed_options(self.pipeline, {**self.definition.fixed_options, **space.nominal})

    def _hand_over_nominal(self, reduction: Reduction, timeout_s: float | None) -> RunPrice:
        """Return what a second model costs, from the nominal one, which is handed over."""
        used = self.sequence(reduction)
        workshop = Workshop(used, self.pipeline, self.means.announce, timeout_s)
        configurations = Configurations(self._nominal, self._nominal, label=_SO_FAR)
        made = hand_over(self.means.folder, workshop, configurations, is_last=False).nominal
        self._model, self.of_model = made.model.trajectory, reduction
        self.means.announce(
            f"the nominal model of {len(used)} images is in {self.means.folder}; it took {made.whole_s:.0f} s"
        )
        only_maps = _earliest_stage(self.definition, self.pipeline) == MAPPING
        price = RunPrice(made.whole_s, made.mapping_s if only_maps else made.whole_s, self.price(reduction).verified_s)
        self._guessed[reduction] = price
        return price


def _earliest_stage(definition: StudyDefinition, pipeline: Pipeline) -> str:
    """Return the first stage that the searched options change."""
    stages = _stage_of(definition, pipeline).values()
    return next((stage for stage in STAGES if stage in stages), MAPPING)


def _stage_of(definition: StudyDefinition, pipeline: Pipeline) -> dict[str, str]:
    """Return the first stage that each searched option changes."""
    return {name: pipeline.options.specs[name].stage for name in definition.space}


def _selection(sequence: Sequence, given: SequenceDefinition, reduction: Reduction) -> dict[str, Any]:
    """Return the frames and the size of a reduced search; few frames and small images stay as they are."""
    longer = sequence.longest_side
    stride = min(round(1 / reduction.frames), max(len(sequence) // _FEWEST_REDUCED_FRAMES, 1))
    return {
        "max_image_size": max(round(longer * reduction.size), min(longer, _SMALLEST_IMAGE)),
        "stride": stride * (given.stride or 1),
    }


def _timed_stages(
    definition: StudyDefinition, pipeline: Pipeline, sequence: Sequence, source: RunSource, frames: int
) -> tuple[dict[str, float], Trajectory, int]:
    """Return the seconds of each stage by name, and of all as ``wall``, nominal's first trajectory, and its runs made.

    The first noisy run is timed as well where that run found stages at hand, is so short that the start of the executor
    rules it, or has fewer than all ``frames``: these may be too few under noise. Both are stored for the nominal trial.

    Raises
    ------
    RunError
        The run failed.
    """
    planner = RunPlanner(pipeline, definition.gtf, SeedSource(definition.search.seed), definition.fixed_options)
    clean, noisy = (
        planner.request(sequence, {}, (kind, 0), sigma=_sigma(definition), number=0) for kind in ("clean", "noisy")
    )
    found, trajectory = _timed(clean, source)
    made = 1
    if (
        len(sequence) < frames
        or found["wall"] < _SHORT_S
        or any(found[name] for name in found if name.endswith("_cached"))
    ):
        other, _ = _timed(noisy, source)
        made = 2
        found = {name: max(found.get(name, 0.0), seconds) for name, seconds in other.items()} | {"wall": other["wall"]}
    stages = {name.removesuffix("_s"): seconds for name, seconds in found.items() if name.endswith("_s")}
    return {**stages, "wall": found["wall"]}, trajectory, made


def _differ(model: Trajectory, other: Trajectory) -> float:
    """Return how far a trajectory is from that of a model, as a fraction of the extent; NaN where none can be said."""
    found = pairwise_matrix([model], [other], AteSettings("sim3"))
    return float(found.errors[0, 0] / found.extents[0, 0])


def price_of_stages(stage_s: Mapping[str, float], earliest: str) -> RunPrice:
    """Return what a run costs whose configuration repeats all from the ``earliest`` stage on.

    ``stage_s`` has the seconds of each stage and the ``wall`` time of all; what is around the stages, starting a
    process and reading its packages, every run pays.
    """
    stages = {stage: stage_s[stage] for stage in STAGES if stage in stage_s}
    whole = max(stage_s["wall"], sum(stages.values()))
    if MAPPING not in stages:
        return RunPrice(whole, whole, whole)

    def without(*cached: str) -> float:
        return whole - sum(stages.get(stage, 0.0) for stage in cached)

    return RunPrice(whole, without(*STAGES[: STAGES.index(earliest)]), without(*STAGES[: STAGES.index("geometry")]))


def _sigma(definition: StudyDefinition) -> float:
    return NOISE_SIGMA if isinstance(definition.gtf.noise_sigma, str) else definition.gtf.noise_sigma


def _timed(request: RunRequest, source: RunSource) -> tuple[dict[str, float], Trajectory]:
    """Return the times of a run, and its trajectory.

    They are the ``wall`` time with what surrounds it, and what its pipeline says of its stages.
    """
    began = time.monotonic()
    run = source.obtain([request])[0]
    if run.stored.error:
        raise RunError(f"the nominal options do not work on '{request.sequence.name}': {run.stored.error}")
    said = {name: float(value) for name, value in run.stored.diagnostics.items() if name.endswith(("_s", "_cached"))}
    wall_s = run.stored.wall_s if run.reused else time.monotonic() - began
    return {**said, "wall": wall_s}, run.trajectory
