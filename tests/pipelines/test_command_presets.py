"""Every preset is run with a stand-in for its program: the command line and the files before it are compared."""

import dataclasses
import json
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.colmap.flags import flag_of
from gtf_tune.pipelines.command import create, load_preset, preset_names
from gtf_tune.sequence import Camera, Sequence
from gtf_tune.testing import ContractCase, FolderStages

# Notes how it is called, and leaves what the real program would: the files of a table, below the working folder or
# below the folder that VSLAM-LAB calls exp_folder.
STAND_IN = """#!{python} -S
import json, os, sys
if sys.argv[1:] == ["-h"]:  # COLMAP's presets ask for the version.
    sys.exit(print("COLMAP 9.9 (Commit x)"))
with open({log!r}, "a") as log:
    log.write(json.dumps(sys.argv[1:]) + "\\n")
words = " ".join(sys.argv)
folder = words.partition("exp_folder")[2].lstrip(": ").split(" ")[0] if "exp_folder" in words else "."
for name, text in json.loads({files!r}).items():
    os.makedirs(os.path.dirname(os.path.join(folder, name)) or ".", exist_ok=True)
    open(os.path.join(folder, name), "w").write(text)
"""
MODEL = {"sparse/0/images.txt": "1 1 0 0 0 -1 0 0 1 000001.pgm\n\n"}
ORB_YAML = (
    "%YAML:1.0\nCamera.fx: 1.0\nCamera.fps: 30\nORBextractor.nFeatures: 1200\nORBextractor.scaleFactor: 1.2\n"
    "ORBextractor.nLevels: 8\nORBextractor.iniThFAST: 20\nORBextractor.minThFAST: 7\n"
)
ORB_OPTIONS = {"ORBextractor.nFeatures": 1500}


@dataclass(frozen=True)
class Expected:
    """What a preset is tried with and what must come of it; T, W and S stand for three folders."""

    settings: Mapping[str, Any]
    commands: str
    leaves: Mapping[str, str]
    options: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)


def colmap(features: str, matches: str, seed: str, matches_seed: str = "", mapper_seed: str = "") -> str:
    return f"""
feature_extractor --database_path S/database.db --image_path W/images --ImageReader.single_camera 1
 --ImageReader.camera_model PINHOLE --ImageReader.camera_params 50.0,51.0,32.5,24.5 --{features}.use_gpu 0
 --{features}.num_threads 1
exhaustive_matcher --database_path S/database.db --{matches}.use_gpu 0 --{matches}.num_threads 1
 --{seed} 7{matches_seed} --TWO.max_error 2.0
mapper --database_path S/database.db --image_path W/images --output_path W/sparse --Mapper.num_threads 1
 --Mapper.extract_colors 0 --{seed} 7{mapper_seed} --Mapper.ba_refine_focal_length 0
"""


COLMAP_OPTIONS = {"TwoViewGeometry.max_error": 2.0, "Mapper.ba_refine_focal_length": False}
DPVO_OPTIONS = (
    "BACKEND_THRESH 64.0 CENTROID_SEL_STRAT RANDOM GLOBAL_OPT_FREQ 15 KEYFRAME_INDEX 4 KEYFRAME_THRESH 15.0 "
    "LOOP_CLOSURE True MAX_EDGE_AGE 1000 MIXED_PRECISION True MOTION_DAMPING 0.5 MOTION_MODEL DAMPED_LINEAR "
    "OPTIMIZATION_WINDOW 10 PATCHES_PER_FRAME 96 PATCH_LIFETIME 13 REMOVAL_WINDOW 22"
)
CALIBRATION_YAML = """\
%YAML 1.2
---
cameras:
  - {cam_name: rgb_0,
     cam_type: gray,
     cam_model: pinhole,
     distortion_type: radtan5,
     focal_length: [50.0, 51.0],
     principal_point: [32.0, 24.0],
     distortion_coefficients: [0.0, 0.0, 0.0, 0.0, 0.0],
     image_dimension: [64, 48],
     fps: 25.0,
     T_BS: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    }
"""
VSLAM_LAB = {
    "settings": {
        "vslam_lab": "T",
        "launcher": ["T/program", "run", "--frozen", "-e", "orbslam2", "execute-mono"],
        "settings": "T/orb.yaml",
        "options": {"nFeatures": {"default": 1000, "key": "ORBextractor.nFeatures"}},
    },
    "leaves": {"00000_KeyFrameTrajectory.csv": "ts (ns),tx,ty,tz,qx,qy,qz,qw\n40000000,1,0,0,0,0,0,1\n"},
    "options": {"nFeatures": 1500},
    "files": {"orb.yaml": ORB_YAML},
    "written": {
        "orb.yaml": ORB_YAML.replace("1200", "1500"),
        "calibration.yaml": CALIBRATION_YAML,
        "rgb.csv": "ts_rgb_0 (ns),path_rgb_0\n0,rgb_0/000000.png\n40000000,rgb_0/000001.png\n"
        "80000000,rgb_0/000002.png\n",
    },
}
ORB_SETTINGS = {"executable": "T/program", "vocabulary": "T/voc", "settings": "T/orb.yaml", "launcher": ["env", "-i"]}

EXPECTED = {
    "colmap-3.8": Expected(
        {"colmap": "T/program"},
        colmap("SiftExtraction", "SiftMatching", "random_seed").replace("TWO", "SiftMatching"),
        MODEL,
        {"SiftMatching.max_error": 2.0, "Mapper.ba_refine_focal_length": False},
    ),
    "colmap-3.9": Expected(
        {"colmap": "T/program"},
        colmap("SiftExtraction", "SiftMatching", "random_seed").replace("TWO", "TwoViewGeometry"),
        MODEL,
        COLMAP_OPTIONS,
    ),
    "colmap-4": Expected(
        {"colmap": "T/program"},
        colmap(
            "FeatureExtraction",
            "FeatureMatching",
            "default_random_seed",
            " --TwoViewGeometry.random_seed 7",
            " --Mapper.random_seed 7",
        ).replace("TWO", "TwoViewGeometry"),
        MODEL,
        COLMAP_OPTIONS,
    ),
    "colmap-4-global": Expected(
        {"colmap": "T/program"},
        colmap("FeatureExtraction", "FeatureMatching", "default_random_seed", " --TwoViewGeometry.random_seed 7")
        .replace("TWO.max_error 2.0", "FeatureMatching.type ALIKED_LIGHTGLUE --TwoViewGeometry.max_error 2.0")
        .replace(
            "--FeatureExtraction.num_threads 1", "--FeatureExtraction.num_threads 1 --FeatureExtraction.type ALIKED_N32"
        )
        .split("\nmapper")[0]
        + """
view_graph_calibrator --database_path S/database.db --default_random_seed 7
global_mapper --database_path S/database.db --image_path W/images --output_path W/sparse --GlobalMapper.num_threads 1
 --GlobalMapper.random_seed 7 --GlobalMapper.gp_use_gpu 0 --GlobalMapper.ba_ceres_use_gpu 0
 --GlobalMapper.max_normalized_reproj_error 0.001""",
        MODEL,
        {
            "FeatureExtraction.type": "ALIKED_N32",
            "FeatureMatching.type": "ALIKED_LIGHTGLUE",
            "TwoViewGeometry.max_error": 2.0,
            "GlobalMapper.max_normalized_reproj_error": 0.001,
        },
    ),
    "glomap": Expected(
        {"colmap": "T/program", "glomap": "T/program"},
        colmap("SiftExtraction", "SiftMatching", "random_seed").replace("TWO", "TwoViewGeometry").split("\nmapper")[0]
        + """
mapper --database_path S/database.db --output_path W/sparse --output_format txt --BundleAdjustment.use_gpu 0
 --GlobalPositioning.use_gpu 0 --BundleAdjustment.thres_loss_function 0.1 --Thresholds.max_reprojection_error 0.001""",
        MODEL,
        {
            "TwoViewGeometry.max_error": 2.0,
            "Thresholds.max_reprojection_error": 0.001,
            "BundleAdjustment.thres_loss_function": 0.1,
        },
    ),
    "orb_slam2": Expected(
        ORB_SETTINGS,
        "T/voc W/settings.yaml W",
        {"KeyFrameTrajectory.txt": "0.040000 1.0000000 0 0 0 0 0 1\n"},
        ORB_OPTIONS,
        {"voc": "", "orb.yaml": ORB_YAML},
        {
            "rgb.txt": "# images\n#\n# timestamp filename\n0.000000 rgb/000000.pgm\n0.040000 rgb/000001.pgm\n"
            "0.080000 rgb/000002.pgm\n",
            "settings.yaml": ORB_YAML.replace("1200", "1500").replace("fx: 1.0", "fx: 50.0").replace("30", "25.0")
            + "Camera.fy: 51.0\nCamera.cx: 32.0\nCamera.cy: 24.0\nCamera.k1: 0.0\nCamera.k2: 0.0\nCamera.p1: 0.0\n"
            "Camera.p2: 0.0\nCamera.k3: 0.0\n",
        },
    ),
    "orb_slam3": Expected(
        ORB_SETTINGS,
        "T/voc W/settings.yaml W W/times.txt",
        {"CameraTrajectory.txt": "40000000.000000 1.000000000 0 0 0 0 0 1\n"},
        ORB_OPTIONS,
        {"voc": "", "orb.yaml": ORB_YAML.replace("Camera.fx", "Camera1.fx")},
        {
            "times.txt": "0\n40000000\n80000000\n",
            "settings.yaml": ORB_YAML.replace("1200", "1500")
            .replace("Camera.fx: 1.0", "Camera1.fx: 50.0")
            .replace("30", "25")
            + "Camera1.fy: 51.0\nCamera1.cx: 32.0\nCamera1.cy: 24.0\nCamera1.k1: 0.0\nCamera1.k2: 0.0\n"
            "Camera1.p1: 0.0\nCamera1.p2: 0.0\nCamera1.k3: 0.0\nCamera.width: 64\nCamera.height: 48\n"
            "Camera.newWidth: 64\nCamera.newHeight: 48\n",
        },
    ),
    "dpvo": Expected(
        {"python": "T/program", "checkout": "T", "network": "T/dpvo.pth", "version_command": []},
        "T/demo.py --network T/dpvo.pth --imagedir W/images --calib W/calibration.txt --config T/config/default.yaml "
        f"--name run --stride 1 --save_trajectory --opts {DPVO_OPTIONS}",
        {"saved_trajectories/run.txt": "1.0 1.0 0 0 0 0 0 1\n"},
        {"LOOP_CLOSURE": True},
        {"dpvo.pth": ""},
        {"calibration.txt": "50.0 51.0 32.0 24.0\n"},
    ),
    "dso": Expected(
        {"executable": "T/program", "size": "32 24"},
        "files=W/images calib=W/camera.txt calib=W/resized.txt preset=2 mode=1 nogui=1 nolog=1 nomt=1",
        {"result.txt": "0.04 1 0 0 0 0 0 1\n"},
        {"preset": "2"},
        {},
        {
            "camera.txt": "RadTan 50.0 51.0 32.0 24.0 0.0 0.0 0.0 0.0\n64 48\ncrop\n64 48\n",
            "resized.txt": "RadTan 50.0 51.0 32.0 24.0 0.0 0.0 0.0 0.0\n64 48\ncrop\n32 24\n",
            "times.txt": "0 0.000000000 0\n1 0.040000000 0\n2 0.080000000 0\n",
        },
    ),
    "stella_vslam": Expected(
        {"executable": "T/program", "vocabulary": "T/voc", "settings": "T/stella.yaml"},
        "-v T/voc -d W -c W/configuration.yaml --no-sleep --wait-loop-ba --auto-term --viewer none "
        "--eval-log-dir W/evaluation",
        {"evaluation/frame_trajectory.txt": "0.04 1 0 0 0 0 0 1\n"},
        {"Feature.num_levels": 6, "Initializer.num_ransac_iterations": 200},
        {"voc": "", "stella.yaml": "Camera:\n  fx: 1.0\n  cols: 640\nFeature:\n  num_levels: 8\n"},
        {
            "configuration.yaml": 'Camera:\n  fx: 50.0\n  cols: 64\n  setup: "monocular"\n  color_order: "Gray"\n'
            "  fy: 51.0\n  cx: 32.0\n  cy: 24.0\n  k1: 0.0\n  k2: 0.0\n  p1: 0.0\n  p2: 0.0\n  k3: 0.0\n  rows: 48\n"
            "  fps: 25.0\nFeature:\n  num_levels: 6\nInitializer:\n  num_ransac_iterations: 200\n",
        },
    ),
    "mast3r_slam": Expected(
        {"python": "T/program", "checkout": "T", "version_command": []},
        "T/main.py --dataset W/images --config W/configuration.yaml --save-as run --no-viz --calib W/intrinsics.yaml",
        {"logs/run/images.txt": "0.033333335 1 0 0 0 0 0 1\n"},
        {"tracking.Q_conf": 2.0},
        {"checkpoints/weights": ""},
        {"intrinsics.yaml": "width: 64\nheight: 48\ncalibration: [50.0, 51.0, 32.0, 24.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n"},
    ),
    "vslam_lab_cpp": Expected(
        commands="run --frozen -e orbslam2 execute-mono sequence_path:W calibration_yaml:W/calibration.yaml "
        "rgb_csv:W/rgb.csv exp_folder:W/experiment exp_id:0 settings_yaml:W/orb.yaml verbose:0 mode:mono",
        **VSLAM_LAB,
    ),
    "vslam_lab_python": Expected(
        commands="run --frozen -e orbslam2 execute-mono --sequence_path W --calibration_yaml W/calibration.yaml "
        "--rgb_csv W/rgb.csv --exp_folder W/experiment --exp_it 0 --settings_yaml W/orb.yaml --verbose 0 --mode mono",
        **VSLAM_LAB,
    ),
}


@pytest.fixture(scope="module")
def frames() -> Sequence:
    sequence = imaginary_sequence(3)
    spaced = tuple(dataclasses.replace(frame, timestamp=frame.frame_id / 25) for frame in sequence.frames)
    return dataclasses.replace(sequence, frames=spaced).with_camera(Camera("PINHOLE", 64, 48, (50.0, 51.0, 32.5, 24.5)))


def in_folder(value: Any, folder: Path) -> Any:
    """Return settings with the folder in the place of T."""
    if isinstance(value, str):
        return str(folder) if value == "T" else value.replace("T/", f"{folder}/")
    if isinstance(value, list):
        return [in_folder(one, folder) for one in value]
    return {name: in_folder(one, folder) for name, one in value.items()} if isinstance(value, dict) else value


def prepare(expected: Expected, folder: Path) -> dict[str, Any]:
    files = {**expected.files, "config/base.yaml": mast3r_yaml()}
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    log, leaves = str(folder / "log"), json.dumps(expected.leaves)
    (folder / "program").write_text(STAND_IN.format(python=sys.executable, log=log, files=leaves))
    (folder / "program").chmod(0o755)
    return dict(in_folder(dict(expected.settings), folder))


def mast3r_yaml() -> str:
    keys = [option["key"].split(".") for option in load_preset("mast3r_slam")["options"].values()]
    sections = dict.fromkeys(section for section, _ in keys)
    defaults = {tuple(name.split(".")): o["default"] for name, o in load_preset("mast3r_slam")["options"].items()}
    lines = ["single_thread: False", "dataset:", "  subsample: 10"]
    for section in sections:
        lines += [f"{section}:", *(f"  {key}: {value}" for (one, key), value in defaults.items() if one == section)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_a_preset_runs_its_program_as_documented(name: str, frames: Sequence, tmp_path: Path) -> None:
    expected = EXPECTED[name]
    pipeline = create({"preset": name, **prepare(expected, tmp_path)})
    (tmp_path / "log").unlink(missing_ok=True)

    output = ContractCase(pipeline, frames).run(tmp_path / "run", FolderStages(tmp_path / "stages"), expected.options)

    work = tmp_path / "run" / "workspace" / "work"
    called = [shlex.join(json.loads(line)) for line in (tmp_path / "log").read_text().splitlines()]
    shown = [_shortened(one, work, tmp_path) for one in called]
    assert shown == expected.commands.strip().replace("\n ", " ").splitlines()
    assert output.trajectory.frame_ids.tolist() == [1]
    assert output.trajectory.positions.tolist() == [[1, 0, 0]]
    assert {path: (work / path).read_text() for path in expected.written} == dict(expected.written)


def _shortened(command: str, work: Path, folder: Path) -> str:
    words = []
    for word in command.split(" "):
        if word.endswith("/database.db"):
            word = "S/database.db"
        words.append(word.replace(str(work), "W").replace(str(folder), "T"))
    return " ".join(words)


def test_every_preset_is_tried() -> None:
    assert set(preset_names()) == set(EXPECTED)


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_cites_its_sources_and_documents_itself(name: str) -> None:
    preset = load_preset(name)

    assert preset["description"]
    assert all(source.startswith("https://github.com/") for source in preset["sources"])
    assert all(one.get("documentation") for one in preset["parameters"].values())


def test_mast3r_slam_sees_every_image_that_the_sequence_has(frames: Sequence, tmp_path: Path) -> None:
    pipeline = create({"preset": "mast3r_slam", **prepare(EXPECTED["mast3r_slam"], tmp_path)})

    ContractCase(pipeline, frames).run(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    written = (tmp_path / "run" / "workspace" / "work" / "configuration.yaml").read_text()
    assert "  subsample: 1\n" in written


def test_dso_works_at_the_size_of_the_images_where_no_other_is_given(frames: Sequence, tmp_path: Path) -> None:
    pipeline = create({"preset": "dso", **prepare(EXPECTED["dso"], tmp_path), "size": ""})

    ContractCase(pipeline, frames).run(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    called = json.loads((tmp_path / "log").read_text().splitlines()[-1])
    assert [word.rsplit("/", 1)[-1] for word in called if word.startswith("calib=")] == ["camera.txt"]
    assert not (tmp_path / "run" / "workspace" / "work" / "resized.txt").exists()


def test_the_preset_of_colmap_4_has_pycolmaps_defaults_but_for_two_that_early_versions_refuse() -> None:
    # COLMAP 4.2 says -1 for these, which 4.0 and 4.1 do not accept; all of them run so many iterations with Ceres.
    iterations = {"Mapper.ba_local_max_num_iterations": 25, "Mapper.ba_global_max_num_iterations": 50}
    specs = create_pipeline("colmap", {}).options.specs
    pycolmaps = {flag_of("colmap", name): spec.default for name, spec in specs.items()}

    defaults = {name: option["default"] for name, option in load_preset("colmap-4")["options"].items()}

    assert len(defaults) > 80
    assert defaults == {name: pycolmaps[name] for name in defaults} | iterations


def test_the_global_preset_of_colmap_4_has_pycolmaps_defaults() -> None:
    specs = create_pipeline("glomap", {}).options.specs
    pycolmaps = {flag_of("glomap", name): spec.default for name, spec in specs.items()}
    learned = {
        "FeatureExtraction.type": "SIFT",
        "FeatureMatching.type": "SIFT_BRUTEFORCE",
        "AlikedExtraction.max_num_features": 2048,
        "AlikedExtraction.min_score": 0.2,
        "AlikedMatching.lightglue_min_score": 0.1,
        "SiftMatching.lightglue_min_score": 0.1,
    }

    defaults = {name: option["default"] for name, option in load_preset("colmap-4-global")["options"].items()}

    assert len(defaults) > 60
    assert defaults == {name: pycolmaps[name] for name in defaults if name not in learned} | learned


@pytest.mark.parametrize("name", ["colmap-3.8", "colmap-3.9", "colmap-4", "colmap-4-global", "glomap"])
def test_colmap_detects_loops_with_a_vocabulary_tree(name: str, frames: Sequence, tmp_path: Path) -> None:
    tree = tmp_path / "tree.bin"
    tree.write_text("tree")
    sequential = {"matcher": "sequential_matcher", "vocabulary_tree": str(tree)}
    pipeline = create({"preset": name, **prepare(EXPECTED[name], tmp_path), **sequential})

    ContractCase(pipeline, frames).run(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    matcher = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()][1]
    assert matcher[0] == "sequential_matcher"
    assert matcher[-4:] == [
        "--SequentialMatching.loop_detection",
        "1",
        "--SequentialMatching.vocab_tree_path",
        str(tree),
    ]
