"""Run any program as a pipeline, from a definition of its command line, its options and its output."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gtf_tune.pipelines.base import PipelineJob, PipelineOutput
from gtf_tune.pipelines.command.definition import TIME_FIELDS, templates_of
from gtf_tune.pipelines.command.inputs import RunInputs, prepare
from gtf_tune.pipelines.command.output import read_output
from gtf_tune.pipelines.command.resolution import ResolvedCommand, resolve
from gtf_tune.pipelines.command.sequence_folder import sequence_key
from gtf_tune.pipelines.command.steps import StepRun
from gtf_tune.pipelines.command.templates import fields_of
from gtf_tune.pipelines.options import OptionTable
from gtf_tune.sequence import Sequence

PLACEHOLDERS = "placeholders.txt"
"""File in the workspace of a run that says what each placeholder stood for."""


@dataclass
class CommandPipeline:
    """Run the programs of a definition one after the other and read the trajectory that they leave."""

    name: str
    version: str
    settings: Mapping[str, str]
    command: ResolvedCommand

    @property
    def options(self) -> OptionTable:
        """Return the options of the definition."""
        return OptionTable(self.name, self.command.definition.option_specs())

    @property
    def reads_times(self) -> bool:
        """Return whether results depend on the times of frames: the program reads them, or its poses have them."""
        definition = self.command.definition
        named = {name for _, template, _ in templates_of(definition) for name, _ in fields_of(template)}
        return definition.output.association == "timestamp" or not TIME_FIELDS.isdisjoint(named)

    @property
    def channels(self) -> Literal[1, 3]:
        """Return 3 where the definition asks for colour images, 1 for grey ones."""
        return self.command.definition.images.channels

    def sequence_key(self, sequence: Sequence) -> str | None:
        """Return the digest of the files beside the images that results depend on, ``None`` where there are none."""
        return sequence_key(self.command.definition, sequence)

    @property
    def takes_several_cameras(self) -> bool:
        """Return whether a step is run for each camera, so that the program learns of all of them."""
        return any(step.each_camera for step in self.command.definition.all_steps)

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return the trajectory that the programs leave.

        Raises
        ------
        RunError
            A program did not end as it should, or its trajectory is missing or unusable.
        """
        inputs = prepare(self.command, job)
        _note(inputs, job.workspace / PLACEHOLDERS)
        diagnostics = StepRun(self.command, job, inputs).run()
        output = self.command.definition.output
        trajectory, repeated = read_output(output, Path(str(inputs.values["output"])), inputs.names, job)
        counts = {"num_poses": len(trajectory)} | ({"num_repeated_poses": repeated} if repeated else {})
        return PipelineOutput(trajectory, {**counts, **diagnostics})


def _note(inputs: RunInputs, path: Path) -> None:
    """Write what each placeholder stands for, a line each, for `pipeline try` and whoever looks into a workspace."""
    path.write_text("".join(f"{{{name}}} = {value}\n" for name, value in sorted(inputs.values.items())), "utf-8")


def create(settings: Mapping[str, object]) -> CommandPipeline:
    """Return the pipeline ``command`` for a preset, a definition file or a whole definition.

    Raises
    ------
    DefinitionError
        The definition is wrong, or something that it names is not on this machine; every fault is named.
    """
    command = resolve(settings)
    return CommandPipeline(
        name="command",
        version=command.version,
        settings={"source": command.source, "identity": command.identity},
        command=command,
    )
