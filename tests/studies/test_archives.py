"""Every study that ships is created on miniatures of the archives that it expects, laid out as they are downloaded."""

import json
from collections.abc import Callable, Iterable, Mapping
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
from gtf_tune.study.open_study import load_defined_sequence, make_pipeline
from gtf_tune.testing import ContractCase, FolderStages
from tests.pipelines.conftest import FOCAL, make_scene
from tests.studies.test_definitions import FILES, FOLDER, options_of

FRAMES = 60


@dataclass(frozen=True)
class Look:
    """What the images of an archive show, and the camera that took them."""

    picture: Callable[[int], np.ndarray]
    width: int
    height: int
    focal: float

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """Return fx, fy, cx and cy in pixels, the centre of the first pixel at 0."""
        return self.focal, self.focal, (self.width - 1) / 2, (self.height - 1) / 2


def grain(seed: int) -> Look:
    """Return images of noise, enough to create a study."""
    return Look(lambda n: np.random.default_rng((seed, n)).integers(0, 255, (24, 32), dtype=np.uint8), 32, 24, 30.0)


def pose(number: int) -> np.ndarray:
    """Return the 4x4 world_from_camera pose of a frame."""
    found = np.eye(4)
    found[:3, 3] = (number, np.sin(number), 0.1 * number)
    return found


def numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)


def tum_row(number: int, stamp: float) -> str:
    return f"{stamp:.6f} {numbers(pose(number)[:3, 3])} 0 0 0 1"


def write_images(folder: Path, name: Callable[[int], str], look: Look) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(FRAMES):
        cv2.imwrite(str(folder / name(number)), look.picture(number))


def write_lines(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def replica(root: Path, look: Look) -> None:
    write_images(root / "results", lambda n: f"frame{n:06d}.jpg", look)
    write_lines(root / "traj.txt", [numbers(pose(n).ravel()) for n in range(FRAMES)])
    fx, fy, cx, cy = look.intrinsics
    camera = {"w": look.width, "h": look.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "scale": 6553.5}
    write_lines(root.parent / "cam_params.json", [json.dumps({"camera": camera})])


def eth3d(root: Path, look: Look) -> None:
    write_images(root / "rgb", lambda n: f"{n / 27:.6f}.png", look)
    write_lines(root / "rgb.txt", [f"{n / 27:.6f} rgb/{n / 27:.6f}.png" for n in range(FRAMES)])
    write_lines(root / "groundtruth.txt", [tum_row(n, n / 27) for n in range(FRAMES)])
    write_lines(root / "calibration.txt", [numbers(look.intrinsics)])


def icl_nuim(root: Path, look: Look) -> None:
    write_images(root / "rgb", lambda n: f"{n}.png", look)
    write_lines(root / "associations.txt", [f"{n} depth/{n}.png {n} rgb/{n}.png" for n in range(FRAMES)])
    write_lines(root / "livingRoom0.gt.freiburg", [tum_row(n, n) for n in range(1, FRAMES)])


def tartanair(root: Path, look: Look) -> None:
    write_images(root, lambda n: f"{n:06d}.png", look)
    truth = [f"{numbers(pose(n)[:3, 3])} 0 0 0 1" for n in range(FRAMES)]
    write_lines(root.parents[1] / "mono_gt" / "ME001.txt", truth)


def frames_of_a_video(root: Path, look: Look) -> None:
    write_images(root, lambda n: f"{n:06d}.png", look)


ARCHIVES: Mapping[str, Callable[[Path, Look], None]] = {
    "Replica/office0": replica,
    "Replica/office1": replica,
    "Replica/office2": replica,
    "eth3d/table_3": eth3d,
    "eth3d/cables_1": eth3d,
    "icl-nuim/living_room_traj0_frei_png": icl_nuim,
    "tartanair/mono/ME001": tartanair,
    "room": eth3d,
    "room-2": eth3d,
    "room-3": eth3d,
    "walk": frames_of_a_video,
}


@dataclass(frozen=True)
class Described:
    """A pipeline whose program need not be here: its name and options are all that a creation reads."""

    name: str
    options: OptionTable
    version: str = "1"
    settings: Mapping[str, Any] = field(default_factory=dict)


def make_study_folders(root: Path) -> None:
    for folder in {path.parent.relative_to(FOLDER) for path in FILES}:
        (root / "studies" / folder).mkdir(parents=True)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the archives below ``storage/data`` and an empty folder for each of ``studies``."""
    root = tmp_path_factory.mktemp("home")
    for seed, (name, write) in enumerate(ARCHIVES.items()):
        write(root / "storage" / "data" / name, grain(seed))
    make_study_folders(root)
    return root


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return create_database(str(tmp_path_factory.mktemp("storage") / "studies.db"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(FOLDER)))
def test_a_study_is_created_on_its_archive(path: Path, home: Path, database: Database) -> None:
    definition = load_definition(path)
    pipeline = Described(definition.pipeline.name, options_of(definition))

    create_study(database, definition, home / "studies" / path.parent.relative_to(FOLDER), pipeline)  # type: ignore[arg-type]

    stored = studies.sequences(database, studies.get(database, definition.name).id)
    assert len(stored) == len(definition.sequences)
    for sequence in stored:
        assert sequence.has_ground_truth == (sequence.name != "walk")
        assert sequence.num_frames in (FRAMES, FRAMES // 10, round(FRAMES / 9))


def test_the_papers_frames_of_replica_are_every_tenth(home: Path) -> None:
    found = load_sequence(home / "storage/data/Replica/office0", layout="replica", selection=Selection(rate_hz=3.0))

    assert [frame.frame_id for frame in found.frames] == list(range(0, FRAMES, 10))


def views(folder: Path) -> Look:
    """Return images that GLOMAP can map: views from a path past rectangles, another one with every ninth frame."""
    scene = make_scene(folder, 1 + FRAMES // 9)
    images = [cv2.imread(str(frame.path), cv2.IMREAD_GRAYSCALE) for frame in scene.frames]
    return Look(lambda n: images[n // 9], scene.cameras[0].width, scene.cameras[0].height, FOCAL)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the archives of the studies of GLOMAP, all showing the same walk."""
    root = tmp_path_factory.mktemp("walked")
    look = views(tmp_path_factory.mktemp("views"))
    for name in {Path(sequence.path) for path in NOMINAL_RUNS for sequence in load_definition(path).sequences}:
        archive = str(name).partition("storage/data/")[2]
        ARCHIVES[archive](root / "storage" / "data" / archive, look)
    make_study_folders(root)
    return root


def nominal_runs() -> list[Path]:
    """Return one study of GLOMAP for each archive and nominal configuration."""
    found: dict[str, Path] = {}
    for path in FILES:
        definition = load_definition(path)
        if definition.pipeline.name == "glomap":
            found.setdefault(repr((definition.sequences, definition.pipeline)), path)
    return list(found.values())


NOMINAL_RUNS = nominal_runs()


@pytest.mark.parametrize("path", NOMINAL_RUNS, ids=lambda path: str(path.relative_to(FOLDER)))
def test_the_nominal_run_of_glomap_registers_every_frame(
    path: Path, walked: Path, tmp_path: Path, stages: FolderStages
) -> None:
    definition = load_definition(path)
    pipeline = make_pipeline(definition)
    for sequence in definition.sequences:
        few = sequence if sequence.max_frames else sequence.model_copy(update={"stride": 10})
        loaded = load_defined_sequence(few, walked / "studies" / path.parent.relative_to(FOLDER), pipeline)

        case = ContractCase(pipeline, loaded, definition.pipeline.options | definition.pipeline.nominal)
        output = case.run(tmp_path / sequence.name, stages)

        assert list(output.trajectory.frame_ids) == [frame.frame_id for frame in loaded.frames]
        assert len(loaded.frames) in (FRAMES // 10, round(FRAMES / 9))


@pytest.fixture(scope="module")
def stages(tmp_path_factory: pytest.TempPathFactory) -> FolderStages:
    """Return stages that all nominal runs share."""
    return FolderStages(tmp_path_factory.mktemp("stages"))
