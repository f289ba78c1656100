from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.report.build import read_configurations
from gtf_tune.report.panels.base import ReportInput
from gtf_tune.report.panels.frames import FrameSpread
from gtf_tune.report.panels.images import contact_sheet, images_panel
from gtf_tune.report.study_data import StudyData
from gtf_tune.sequence import Sequence, load_sequence
from gtf_tune.store.database import Database
from tests.report.conftest import FRAMES
from tests.study.conftest import write_sequence


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Return a sequence of 12 small images."""
    return load_sequence(write_sequence(tmp_path_factory.mktemp("images") / "walk", ground_truth=False, frames=12))


def spread(moved: list[float], fragile: tuple[int, ...] = ()) -> FrameSpread:
    """Return frames 0, 1, ... that move so far; every run registered them."""
    marks = np.isin(np.arange(len(moved)), fragile)
    return FrameSpread("trial 1", np.arange(len(moved)), np.array(moved), np.ones(len(moved)), marks)


def test_a_contact_sheet_shows_all_images_where_they_are_few(images: Sequence) -> None:
    sheet = contact_sheet(images, spread([1.0] * 12))

    assert [thumbnail.frame.frame_id for thumbnail in sheet] == list(range(12))


def test_fragile_frames_are_on_the_sheet_between_evenly_spread_others(images: Sequence) -> None:
    sheet = contact_sheet(images, spread([1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0, 7.0, 1.0, 1.0, 1.0, 1.0], (2, 7)), most=5)

    assert [thumbnail.frame.frame_id for thumbnail in sheet if thumbnail.is_fragile] == [2, 7]
    others = [thumbnail.frame.frame_id for thumbnail in sheet if not thumbnail.is_fragile]
    assert (others[0], others[-1], len(others)) == (0, 11, 3)


def test_frames_that_no_run_registered_are_marked(images: Sequence) -> None:
    sheet = contact_sheet(images, spread([2.0] * 10))

    assert [thumbnail.registered for thumbnail in sheet] == [1.0] * 10 + [0.0] * 2
    assert all(np.isnan(thumbnail.moved) for thumbnail in sheet[10:])


def test_the_panel_shows_the_images_with_words_for_a_screen_reader(
    database: Database, data: StudyData, tmp_path: Path
) -> None:
    write_sequence(tmp_path / "data" / "walk", ground_truth=False, frames=FRAMES)
    here = replace(data, study=replace(data.study, root=str(tmp_path)))

    (shown,) = images_panel(ReportInput(here, configurations=read_configurations(database, data)))

    assert isinstance(shown, str)
    assert shown.count("<img ") == FRAMES
    assert 'alt="walk, frame 0: ' in shown
    assert len(shown) < 250_000


def test_images_that_lie_elsewhere_are_a_sentence(database: Database, data: StudyData) -> None:
    (shown,) = images_panel(ReportInput(data, configurations=read_configurations(database, data)))

    assert isinstance(shown, str)
    assert "walk: the images cannot be shown" in shown
    assert "<img" not in shown
