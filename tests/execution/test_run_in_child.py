from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from gtf_tune.execution import InlineExecutor
from gtf_tune.pipelines import OptionTable, PipelineJob, PipelineOutput
from tests.execution.doubles import SEQUENCE, analytic, request_of
from tests.execution.executor_contract import LIMITS


@dataclass
class Numbering:
    """Return the poses as a reader of TUM files does: numbered by their order."""

    left_out: int = 0
    name: str = "numbering"
    version: str = "1"
    settings: Mapping[str, str] = field(default_factory=dict)

    @property
    def options(self) -> OptionTable:
        return analytic().options

    def run(self, job: PipelineJob) -> PipelineOutput:
        output = analytic().run(job)
        kept = output.trajectory.select(np.arange(len(output.trajectory) - self.left_out))
        return PipelineOutput(replace(kept, frame_ids=np.arange(len(kept)), ids_are_counted=True))


def test_poses_numbered_by_their_order_get_the_frame_ids_of_the_images_where_there_is_one_of_each() -> None:
    frames = tuple(replace(frame, frame_id=2 * frame.frame_id) for frame in SEQUENCE.frames)
    request = replace(request_of(analytic()), pipeline=Numbering(), sequence=replace(SEQUENCE, frames=frames))

    outcome = InlineExecutor().submit(request, LIMITS).result()

    assert outcome.trajectory.frame_ids.tolist() == [frame.frame_id for frame in frames]
    assert not outcome.trajectory.ids_are_counted


@pytest.mark.parametrize("left_out", [1, 5])
def test_poses_numbered_by_their_order_are_refused_where_one_is_missing(left_out: int) -> None:
    request = replace(request_of(analytic()), pipeline=Numbering(left_out))

    outcome = InlineExecutor().submit(request, LIMITS).result()

    assert outcome.status == "failed"
    assert f"gave back {12 - left_out} poses for 12 images, numbered by their order only" in outcome.error
