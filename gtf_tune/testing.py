"""Prove that a pipeline keeps the contract: a test class to inherit from.

A test of a pipeline, in this package or in another one, is a subclass with one fixture::

    class TestMyPipeline(PipelineContract):
        @pytest.fixture(scope="class")
        @classmethod
        def case(cls):
            return ContractCase(create_pipeline("mine"), my_sequence)

pytest is imported here and nowhere else in the package.
"""

# ruff: noqa: S101 (assertions are what this file is for)

import hashlib
import math
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.errors import OptionError
from gtf_tune.pipelines import OptionSpec, OptionValue, Pipeline, PipelineJob, PipelineOutput
from gtf_tune.sequence import ImageSource, Sequence
from gtf_tune.trajectory import to_bytes

_UNKNOWN = "no.such.option.anywhere"


@dataclass(frozen=True)
class ContractCase:
    """What the contract is tried on: a pipeline, a sequence that it can reconstruct, and options for the runs.

    The sequence should be small: it is reconstructed from its pixels twice.
    """

    pipeline: Pipeline
    sequence: Sequence
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    seed: int = 7

    def job(self, folder: Path, stages: "FolderStages", options: Mapping[str, OptionValue]) -> PipelineJob:
        """Return a job with a new workspace below ``folder``."""
        workspace = folder / "workspace"
        workspace.mkdir(parents=True)
        return PipelineJob(
            images=ImageSource(self.sequence),
            options=self.pipeline.options.check({**self.options, **options}),
            seed=self.seed,
            threads=1,
            workspace=workspace,
            stages=stages,
        )

    def run(
        self, folder: Path, stages: "FolderStages", options: Mapping[str, OptionValue] | None = None
    ) -> PipelineOutput:
        """Run the pipeline once in ``folder``."""
        return self.pipeline.run(self.job(folder, stages, options or {}))


@dataclass
class FolderStages:
    """Keep stages in a folder, and remember which were reached and which of them had to be built."""

    folder: Path
    built: list[tuple[str, str]] = field(default_factory=list)

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        """Return the folder of a stage, building it the first time."""
        place = self.folder / f"{stage}-{key}"
        if not place.exists():
            aside = self.folder / f"building-{stage}-{key}"
            aside.mkdir(parents=True)
            build(aside)
            aside.rename(place)
            self.built.append((stage, key))
        return place

    def contents(self) -> dict[str, str]:
        """Return the SHA-256 of every file."""
        return _contents(self.folder)


@dataclass(frozen=True)
class ContractRuns:
    """The runs that most of the contract is read off: two from pixels, one from the stages of the second."""

    first: PipelineOutput
    second: PipelineOutput
    cached: PipelineOutput
    stages: FolderStages
    stages_before: Mapping[str, str]
    stray_files: tuple[str, ...]


class PipelineContract:
    """Check the promises of `gtf_tune.pipelines.Pipeline`; subclasses give the fixture ``case``."""

    @pytest.fixture(scope="class")
    @classmethod
    def case(cls) -> ContractCase:
        """Return what to test; every subclass has its own."""
        pytest.fail("a subclass of PipelineContract needs a class-scoped fixture 'case'", pytrace=False)

    @pytest.fixture(scope="class")
    @classmethod
    def runs(cls, case: ContractCase, tmp_path_factory: pytest.TempPathFactory) -> ContractRuns:
        """Run the pipeline three times, in an empty current folder."""
        base, here = tmp_path_factory.mktemp("contract"), tmp_path_factory.mktemp("current")
        stages = FolderStages(base / "kept")
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(here)
            first = case.run(base / "first", FolderStages(base / "fresh"))
            second = case.run(base / "second", stages)
            before = stages.contents()
            cached = case.run(base / "cached", stages)
        return ContractRuns(first, second, cached, stages, before, tuple(sorted(_contents(here))))

    def test_equal_jobs_give_equal_bytes(self, runs: ContractRuns) -> None:
        """Two runs from the pixels agree to the last bit."""
        assert to_bytes(runs.first.trajectory) == to_bytes(runs.second.trajectory)

    def test_stages_at_hand_change_nothing(self, runs: ContractRuns) -> None:
        """A run from cached stages agrees with one from the pixels to the last bit."""
        assert to_bytes(runs.cached.trajectory) == to_bytes(runs.second.trajectory)

    def test_stages_are_only_read(self, runs: ContractRuns) -> None:
        """A run leaves the stages that it finds as they are."""
        assert runs.stages.contents() == runs.stages_before

    def test_nothing_is_written_to_the_current_folder(self, runs: ContractRuns) -> None:
        """Files appear in the workspace and the stages only."""
        assert runs.stray_files == ()

    def test_poses_belong_to_frames_of_the_job(self, case: ContractCase, runs: ContractRuns) -> None:
        """The trajectory has poses, and only for frames that were given."""
        given = {frame.frame_id for frame in case.sequence.frames}
        found = set(runs.first.trajectory.frame_ids.tolist())
        assert found
        assert found <= given

    def test_timestamps_are_those_of_the_frames(self, case: ContractCase, runs: ContractRuns) -> None:
        """Each pose has the time of its frame."""
        times = {frame.frame_id: frame.timestamp for frame in case.sequence.frames}
        trajectory = runs.first.trajectory
        expected = [times[frame_id] for frame_id in trajectory.frame_ids.tolist()]
        assert trajectory.timestamps.tolist() == expected

    def test_diagnostics_are_short_scalars(self, runs: ContractRuns) -> None:
        """Diagnostics can be stored and plotted: no arrays, no long texts, no infinities."""
        for name, value in runs.first.diagnostics.items():
            assert isinstance(value, bool | int | float | str), name
            assert not isinstance(value, float) or math.isfinite(value), name
            assert len(str(value)) < 100, name

    def test_explicit_defaults_change_nothing(self, case: ContractCase, runs: ContractRuns, tmp_path: Path) -> None:
        """Naming a default is the same as leaving it out: no stage is built again, the result is equal."""
        built = list(runs.stages.built)
        defaults = {name: spec.default for name, spec in case.pipeline.options.specs.items()}
        output = case.run(tmp_path, runs.stages, {**defaults, **case.options})
        assert runs.stages.built == built
        assert to_bytes(output.trajectory) == to_bytes(runs.second.trajectory)

    def test_options_describe_themselves(self, case: ContractCase) -> None:
        """The table has options, under their own names, with defaults inside their ranges."""
        specs = case.pipeline.options.specs
        assert specs
        for name, spec in specs.items():
            assert name == spec.name
            assert _default_fits(spec), name

    def test_every_default_passes_its_own_check(self, case: ContractCase) -> None:
        """Each default is accepted alone, all are accepted together, and they keep their type and value."""
        table = case.pipeline.options
        defaults = {name: spec.default for name, spec in table.specs.items()}
        for name, default in defaults.items():
            assert table.check({name: default}) == {name: default}
        assert table.check(defaults) == defaults

    def test_unknown_options_are_refused(self, case: ContractCase) -> None:
        """A name that the pipeline does not know is an error that says it."""
        with pytest.raises(OptionError, match=_UNKNOWN):
            case.pipeline.options.check({_UNKNOWN: 1})

    def test_values_of_another_type_are_refused(self, case: ContractCase) -> None:
        """No option takes a list."""
        for name in case.pipeline.options.specs:
            with pytest.raises(OptionError):
                case.pipeline.options.check({name: [1]})

    def test_pipelines_travel_between_processes(self, case: ContractCase) -> None:
        """A pickled pipeline is the same pipeline."""
        travelled: Any = pickle.loads(pickle.dumps(case.pipeline))
        assert (travelled.name, travelled.version) == (case.pipeline.name, case.pipeline.version)
        assert dict(travelled.settings) == dict(case.pipeline.settings)
        assert dict(travelled.options.specs) == dict(case.pipeline.options.specs)

    def test_what_identifies_the_pipeline_is_text(self, case: ContractCase) -> None:
        """Name and version are not empty, and settings are short texts, because keys of runs are made of them."""
        assert case.pipeline.name
        assert case.pipeline.version
        assert all(isinstance(value, str) for value in case.pipeline.settings.values())


def _default_fits(spec: OptionSpec) -> bool:
    if spec.choices:
        return spec.default in spec.choices
    low = -math.inf if spec.low is None else spec.low
    high = math.inf if spec.high is None else spec.high
    return isinstance(spec.default, str | bool) or low <= spec.default <= high


def _contents(folder: Path) -> dict[str, str]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
