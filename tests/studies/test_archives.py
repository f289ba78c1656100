"""Every study that ships is created on miniatures of the archives that it expects, laid out as they are downloaded."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gtf_tune.definition import load_definition
from gtf_tune.pipelines import OptionTable
from gtf_tune.sequence import load_sequence
from gtf_tune.sequence.selection import Selection
from gtf_tune.store import studies
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.create import create_study
from tests.studies.test_definitions import FILES, FOLDER, options_of

FRAMES = 60
WIDTH, HEIGHT = 32, 24


def pose(number: int) -> np.ndarray:
    """Return the 4x4 world_from_camera pose of a frame."""
    found = np.eye(4)
    found[:3, 3] = (number, np.sin(number), 0.1 * number)
    return found


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:g}" for value in values)


def tum_row(number: int, stamp: float) -> str:
    return f"{stamp:.6f} {numbers(pose(number)[:3, 3])} 0 0 0 1"


def write_images(folder: Path, name: Callable[[int], str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(FRAMES):
        image = np.random.default_rng(number).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)
        cv2.imwrite(str(folder / name(number)), image)


def write_lines(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def replica(root: Path) -> None:
    write_images(root / "results", lambda n: f"frame{n:06d}.jpg")
    write_lines(root / "traj.txt", [numbers(pose(n).ravel()) for n in range(FRAMES)])
    camera = f'"w": {WIDTH}, "h": {HEIGHT}, "fx": 30.0, "fy": 30.0, "cx": 15.5, "cy": 11.5, "scale": 6553.5'
    write_lines(root.parent / "cam_params.json", [f'{{"camera": {{{camera}}}}}'])


def eth3d(root: Path) -> None:
    write_images(root / "rgb", lambda n: f"{n / 27:.6f}.png")
    write_lines(root / "rgb.txt", [f"{n / 27:.6f} rgb/{n / 27:.6f}.png" for n in range(FRAMES)])
    write_lines(root / "groundtruth.txt", [tum_row(n, n / 27) for n in range(FRAMES)])
    write_lines(root / "calibration.txt", ["30 30 15.5 11.5"])


def icl_nuim(root: Path) -> None:
    write_images(root / "rgb", lambda n: f"{n}.png")
    write_lines(root / "associations.txt", [f"{n} depth/{n}.png {n} rgb/{n}.png" for n in range(FRAMES)])
    write_lines(root / "livingRoom0.gt.freiburg", [tum_row(n, n) for n in range(1, FRAMES)])


def tartanair(root: Path) -> None:
    write_images(root, lambda n: f"{n:06d}.png")
    truth = [f"{numbers(pose(n)[:3, 3])} 0 0 0 1" for n in range(FRAMES)]
    write_lines(root.parents[1] / "mono_gt" / "ME001.txt", truth)


ARCHIVES: Mapping[str, Callable[[Path], None]] = {
    "Replica/office0": replica,
    "Replica/office2": replica,
    "eth3d/table_3": eth3d,
    "eth3d/cables_1": eth3d,
    "icl-nuim/living_room_traj0_frei_png": icl_nuim,
    "tartanair/mono/ME001": tartanair,
    "room": eth3d,
}


@dataclass(frozen=True)
class Described:
    """A pipeline whose program need not be here: its name and options are all that a creation reads."""

    name: str
    options: OptionTable
    version: str = "1"
    settings: Mapping[str, Any] = field(default_factory=dict)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the archives below ``storage/data`` and an empty folder for each of ``studies``."""
    root = tmp_path_factory.mktemp("home")
    for name, write in ARCHIVES.items():
        write(root / "storage" / "data" / name)
    for path in FILES:
        (root / "studies" / path.parent.relative_to(FOLDER)).mkdir(parents=True, exist_ok=True)
    return root


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return create_database(str(tmp_path_factory.mktemp("storage") / "studies.db"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_study_is_created_on_its_archive(path: Path, home: Path, database: Database) -> None:
    definition = load_definition(path)
    pipeline = Described(definition.pipeline.name, options_of(definition))

    create_study(database, definition, home / "studies" / path.parent.relative_to(FOLDER), pipeline)  # type: ignore[arg-type]

    (sequence,) = studies.sequences(database, studies.get(database, definition.name).id)
    assert sequence.has_ground_truth
    assert sequence.num_frames in (FRAMES, FRAMES // 10, round(FRAMES / 9))


def test_the_papers_frames_of_replica_are_every_tenth(home: Path) -> None:
    found = load_sequence(home / "storage/data/Replica/office0", layout="replica", selection=Selection(rate_hz=3.0))

    assert [frame.frame_id for frame in found.frames] == list(range(0, FRAMES, 10))
