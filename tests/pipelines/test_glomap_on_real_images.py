"""GLOMAP on real photographs, where GTF_TUNE_DATA names a folder with the sequence dtu-scan24."""

import os
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import Selection, Sequence, load_sequence
from gtf_tune.testing import ContractCase, FolderStages

FRAMES = 12


@pytest.fixture(scope="module")
def photographs() -> Sequence:
    folder = Path(os.environ.get("GTF_TUNE_DATA", "")) / "dtu-scan24"
    if not os.environ.get("GTF_TUNE_DATA") or not folder.is_dir():
        pytest.skip("GTF_TUNE_DATA does not name a folder with the sequence dtu-scan24")
    return load_sequence(folder, selection=Selection(max_frames=FRAMES))


def test_glomap_finds_the_cameras_of_photographs(photographs: Sequence, tmp_path: Path) -> None:
    case = ContractCase(
        create_pipeline("glomap"),
        photographs,
        {
            "mapper.bundle_adjustment.refine_focal_length": False,
            "mapper.bundle_adjustment.refine_extra_params": False,
        },
    )

    found = case.run(tmp_path, FolderStages(tmp_path / "stages")).trajectory

    assert photographs.ground_truth is not None
    extent = float(np.linalg.norm(photographs.ground_truth.positions.std(axis=0)))
    assert len(found) == FRAMES
    assert ate(photographs.ground_truth, found) < 0.02 * extent
