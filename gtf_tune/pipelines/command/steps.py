"""Run the steps of a command, keeping the results of those that are cached."""

import contextlib
import os
import shlex
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from gtf_tune.pipelines.base import DiagnosticValue, PipelineJob
from gtf_tune.pipelines.command.cuda_lock import cuda_device, cuda_lock
from gtf_tune.pipelines.command.definition import (
    TIME_FIELDS,
    Arguments,
    OptionDefinition,
    StepDefinition,
    templates_of,
    words_of,
)
from gtf_tune.pipelines.command.inputs import RunInputs
from gtf_tune.pipelines.command.process import check_exit, run_program
from gtf_tune.pipelines.command.resolution import ResolvedCommand
from gtf_tune.pipelines.command.sequence_folder import sequence_key
from gtf_tune.pipelines.command.templates import Value, fields_of, filled, filled_arguments
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.pipelines.run import digest
from gtf_tune.pipelines.stage_clock import StageClock


@dataclass
class StepRun:
    """Run all steps of one job."""

    command: ResolvedCommand
    job: PipelineJob
    inputs: RunInputs
    clock: StageClock = field(default_factory=StageClock)

    def run(self) -> Mapping[str, DiagnosticValue]:
        """Run every step that is not at hand already, and return what each took.

        Raises
        ------
        RunError
            A program did not end as it should.
        """
        steps = self.command.definition.all_steps
        state, key = None, ""
        for step in steps:
            if step.cached:
                key = self._key(step, key)
                state = self._reach(step, key, state)
        working = self.job.workspace / "state"
        _copy(state, working)
        for step in steps:
            if not step.cached:
                self._execute(step, working)
        return self.clock.diagnostics(
            [step.name for step in steps if step.cached], [step.name for step in steps if not step.cached]
        )

    def _reach(self, step: StepDefinition, key: str, previous: Path | None) -> Path:
        def build(folder: Path) -> None:
            _copy(previous, folder)
            self._execute(step, folder)

        return self.job.stages.reach(step.name, key, build)

    def _key(self, step: StepDefinition, previous: str) -> str:
        """Return the key of a cached step: all that its results and those of the steps before it depend on."""
        options = self.command.definition.options
        beside = sequence_key(self.command.definition, self.job.images.sequence)
        reads_times = any(self._reads(name, step) for name in TIME_FIELDS)
        times = [frame.timestamp for frame in self.job.images.sequence.frames]
        mine = {name: value for name, value in self.inputs.options.items() if options[name].step in ("", step.name)}
        return digest(
            {
                "command": [self.command.identity, self.command.version],
                "step": step.name,
                "previous": previous or [self.job.images.key, self.job.images.sequence.cameras_key],
                "options": mine,
                "seed": self.job.seed if self._reads("seed", step) else None,
                "threads": self.job.threads,
                **({"times": times} if reads_times else {}),
                **({"sequence": beside} if beside else {}),
            }
        )

    def _reads(self, name: str, step: StepDefinition) -> bool:
        own = {found for word in words_of(step.arguments) for found, _ in fields_of(word)}
        return name in own or name in self._shared_fields

    @cached_property
    def _shared_fields(self) -> frozenset[str]:
        """Return the placeholders that all steps may read through files, settings or the environment."""
        return frozenset(
            name
            for place, template, _ in templates_of(self.command.definition)
            if not place.startswith("step ")
            for name, _ in fields_of(template)
        )

    def _execute(self, step: StepDefinition, state: Path) -> None:
        values: dict[str, Value] = {**self.inputs.values, "state": state, "options": self._option_words(step)}
        if step.each_camera and self.inputs.cameras:
            for camera in self.inputs.cameras:
                self._start(step, (*step.arguments, *step.each_camera), {**values, **camera})
        else:
            self._start(step, step.arguments, values)

    def _start(self, step: StepDefinition, templates: Arguments, values: Mapping[str, Value]) -> None:
        definition = self.command.definition
        words = definition.boolean_words
        arguments = _started_anywhere(filled_arguments(templates, values, words))
        sys.stdout.write(f"+ {shlex.join(arguments)}\n")
        with contextlib.ExitStack() as held, self.clock.timing(step.name):
            locks = [held.enter_context(cuda_lock(cuda_device(), self.job.waiting))] if definition.gpu else []
            ended = run_program(
                arguments,
                Path(filled(definition.working_folder, values, words)),
                {name: filled(template, values, words) for name, template in definition.environment.items()},
                self.job.workspace / f"report-{step.name}.json",
                locks,
            )
        program = os.path.basename(arguments[0])
        check_exit(f"step '{step.name}' ({program})" if definition.steps else program, ended, definition.exit_codes)

    def _option_words(self, step: StepDefinition) -> tuple[str, ...]:
        """Return the arguments that ``{options}`` stands for in a step, in the order of the options' names."""
        definition = self.command.definition
        words: list[str] = []
        for name, option in sorted(definition.options.items()):
            value = self.inputs.options[name]
            listed = option.step in ("", step.name) and not option.key and name not in self._named_options
            if listed and (definition.options_passed == "all" or value != option.default):
                words += self._words_of(name, option, value)
        return tuple(words)

    @cached_property
    def _named_options(self) -> frozenset[str]:
        templates = templates_of(self.command.definition)
        return frozenset(
            detail for _, template, _ in templates for name, detail in fields_of(template) if name == "option"
        )

    def _words_of(self, name: str, option: OptionDefinition, value: OptionValue) -> list[str]:
        templates = self.command.definition.option_arguments
        if option.arguments is not None:
            templates = option.arguments_if_false if value is False else option.arguments
        values: dict[str, Value] = {**self.inputs.values, "name": name, "value": value}
        return filled_arguments(templates, values, self.command.definition.boolean_words)


def _started_anywhere(arguments: list[str]) -> list[str]:
    """Return the words with a relative path of the program made absolute: it was found from here, not from the run."""
    program = arguments[0]
    return [os.path.abspath(program) if os.path.dirname(program) else program, *arguments[1:]]


def _copy(previous: Path | None, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    if previous:
        shutil.copytree(previous, folder, dirs_exist_ok=True)
