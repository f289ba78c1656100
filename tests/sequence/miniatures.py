"""Valid miniatures of every layout, as small as they come: five images of 64x48 pixels each."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
import yaml

COUNT = 5
WIDTH, HEIGHT = 64, 48
START_NS = 1403636579763555584
STEP_NS = 200_000_000
PERIOD_S = 0.2

# A camera that turns a little about its vertical axis from frame to frame, on a curve.
ANGLES = [0.1 * number for number in range(COUNT)]
CENTRES = [(float(number), 0.1 * number**2, 0.5) for number in range(COUNT)]


def _rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def matrix(number: int) -> np.ndarray:
    """Return the 4x4 world_from_camera pose of a frame."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = _rotation(ANGLES[number]), CENTRES[number]
    return pose


def quaternion(number: int) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a frame."""
    half = ANGLES[number] / 2
    return 0.0, float(np.sin(half)), 0.0, float(np.cos(half))


def stamp(number: int) -> int:
    return START_NS + number * STEP_NS


def images(folder: Path, names: list[str]) -> None:
    for number, name in enumerate(names):
        blocks = np.random.default_rng(number).integers(0, 255, (6, 8, 3), dtype=np.uint8)
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), cv2.resize(blocks, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST))


def text(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def row(*values: object) -> str:
    return " ".join(f"{value}" for value in values)


def tum(root: Path) -> None:
    images(root, [f"rgb/{n}.png" for n in range(COUNT)])
    text(root / "rgb.txt", ["# timestamp filename", *(row(n * PERIOD_S, f"rgb/{n}.png") for n in range(COUNT))])
    poses = [row(n * PERIOD_S, *CENTRES[n], *quaternion(n)) for n in range(COUNT)]
    text(root / "groundtruth.txt", ["# timestamp tx ty tz qx qy qz qw", *poses])
    text(root / "calibration.txt", ["50 51 31.5 23.5"])


def kitti(root: Path) -> None:
    images(root, [f"image_0/{n:06d}.png" for n in range(COUNT)])
    text(root / "times.txt", [f"{n * PERIOD_S:e}" for n in range(COUNT)])
    text(root / "calib.txt", ["P0: 50 0 31.5 0 0 51 23.5 0 0 0 1 0", "P1: 50 0 31.5 -9 0 51 23.5 0 0 0 1 0"])
    text(root / "poses.txt", [row(*matrix(n)[:3].ravel()) for n in range(COUNT)])


SENSOR = {
    "sensor_type": "camera",
    "T_BS": {"cols": 4, "rows": 4, "data": [0, -1, 0, -0.02, 1, 0, 0, -0.06, 0, 0, 1, 0.01, 0, 0, 0, 1]},
    "resolution": [WIDTH, HEIGHT],
    "camera_model": "pinhole",
    "intrinsics": [50.0, 51.0, 31.5, 23.5],
    "distortion_model": "radial-tangential",
    "distortion_coefficients": [-0.28, 0.07, 0.0002, 1.8e-05],
}


def euroc(root: Path) -> None:
    camera = root / "mav0" / "cam0"
    images(camera / "data", [f"{stamp(n)}.png" for n in range(COUNT)])
    text(camera / "data.csv", ["#timestamp [ns],filename", *(f"{stamp(n)},{stamp(n)}.png" for n in range(COUNT))])
    (camera / "sensor.yaml").write_text(yaml.safe_dump(SENSOR, sort_keys=False))
    body_poses(root / "mav0" / "state_groundtruth_estimate0" / "data.csv")


def body_poses(path: Path) -> None:
    rows = []
    for n in range(COUNT):
        x, y, z, w = quaternion(n)
        rows.append(",".join(str(value) for value in (stamp(n), *CENTRES[n], w, x, y, z)))
    text(path, ["#timestamp, p_RS_R_x [m], ...", *rows])


def icl_nuim(root: Path) -> None:
    images(root, [f"rgb/{n}.png" for n in range(COUNT)])
    text(root / "associations.txt", [row(n, f"depth/{n}.png", n, f"rgb/{n}.png") for n in range(COUNT)])
    text(root / "traj0.gt.freiburg", [row(n, *CENTRES[n], *quaternion(n)) for n in range(COUNT)])


def seven_scenes(root: Path) -> None:
    images(root, [f"frame-{n:06d}.color.png" for n in range(COUNT)])
    for n in range(COUNT):
        text(root / f"frame-{n:06d}.pose.txt", [row(*line) for line in matrix(n)])


def scannet(root: Path) -> None:
    images(root, [f"color/{n}.jpg" for n in range(COUNT)])
    for n in range(COUNT):
        text(root / "pose" / f"{n}.txt", [row(*line) for line in matrix(n)])
    text(root / "intrinsic" / "intrinsic_color.txt", ["50 0 31.5 0", "0 51 23.5 0", "0 0 1 0", "0 0 0 1"])


def replica(root: Path) -> None:
    images(root, [f"results/frame{n:06d}.jpg" for n in range(COUNT)])
    text(root / "traj.txt", [row(*matrix(n).ravel()) for n in range(COUNT)])
    camera = {"w": WIDTH, "h": HEIGHT, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5, "scale": 6553.5}
    (root / "cam_params.json").write_text(json.dumps({"camera": camera}))


def tartanair(root: Path) -> None:
    images(root, [f"image_left/{n:06d}_left.png" for n in range(COUNT)])
    text(root / "pose_left.txt", [row(*CENTRES[n], *quaternion(n)) for n in range(COUNT)])


def colmap(root: Path) -> None:
    images(root, [f"images/{n}.png" for n in range(COUNT)])
    model_text(root / "sparse" / "0", [f"{n}.png" for n in range(COUNT)])


def model_text(folder: Path, names: list[str], cameras: Mapping[str, int] | None = None) -> None:
    """Write a model of images on the x axis; ``cameras`` are the ids of those that are not of camera 1."""
    text(folder / "cameras.txt", ["1 PINHOLE 64 48 50 51 32 24"])
    lines = []
    for number, name in enumerate(names):
        camera = (cameras or {}).get(name, 1)
        lines += [row(number + 1, 1, 0, 0, 0, -number, 0.1 * number**2, 0, camera, name), ""]
    text(folder / "images.txt", lines)


def transforms(**values: object) -> dict[str, object]:
    frames = [{"file_path": f"images/{n}.png", "transform_matrix": matrix(n).tolist()} for n in range(COUNT)]
    return {**values, "frames": frames}


INTRINSICS = {"fl_x": 50.0, "fl_y": 51.0, "cx": 32.0, "cy": 24.0, "w": WIDTH, "h": HEIGHT}


def nerf(root: Path, **values: object) -> None:
    images(root, [f"images/{n}.png" for n in range(COUNT)])
    known = {**INTRINSICS, "camera_model": "OPENCV", "k1": 0.1, "k2": 0.0, "p1": 0.0, "p2": 0.0, **values}
    (root / "transforms.json").write_text(json.dumps(transforms(**known)))


def strecha(root: Path) -> None:
    images(root, [f"{n:04d}.png" for n in range(COUNT)])
    for n in range(COUNT):
        pose = matrix(n)
        lines = ["50 0 31.5", "0 51 23.5", "0 0 1", "0 0 0", *(row(*line) for line in pose[:3, :3])]
        text(root / f"{n:04d}.png.camera", [*lines, row(*pose[:3, 3]), f"{WIDTH} {HEIGHT}"])


def folder(root: Path) -> None:
    images(root, [f"{n}.png" for n in range(COUNT)])


def vslam_lab(root: Path) -> None:
    images(root, [f"rgb_0/{n:06d}.png" for n in range(COUNT)])
    text(root / "rgb.csv", ["ts_rgb_0 (ns),path_rgb_0", *(f"{stamp(n)},rgb_0/{n:06d}.png" for n in range(COUNT))])
    poses = [",".join(str(value) for value in (stamp(n), *CENTRES[n], *quaternion(n))) for n in range(COUNT)]
    text(root / "groundtruth.csv", ["ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw", *poses])
    camera = {
        "cam_name": "rgb_0",
        "cam_model": "pinhole",
        "focal_length": [50.0, 51.0],
        "principal_point": [31.5, 23.5],
        "image_dimension": [WIDTH, HEIGHT],
        "distortion_type": "radtan5",
        "distortion_coefficients": [0.1, 0.0, 0.0, 0.0, 0.2],
        "fps": 5.0,
    }
    (root / "calibration.yaml").write_text(yaml.safe_dump({"cameras": [camera]}, sort_keys=False))


LAYOUTS: Mapping[str, Callable[[Path], None]] = {
    "vslam-lab": vslam_lab,
    "eth3d-slam": tum,
    "kitti": kitti,
    "euroc": euroc,
    "icl-nuim": icl_nuim,
    "7-scenes": seven_scenes,
    "scannet": scannet,
    "replica": replica,
    "tartanair": tartanair,
    "colmap": colmap,
    "nerf": nerf,
    "strecha": strecha,
    "folder": folder,
}
"""Functions that write a miniature into a folder, by the layout's name."""

CALIBRATIONS: Mapping[str, str] = {
    "vslam-lab": "calibration.yaml",
    "eth3d-slam": "calibration.txt",
    "kitti": "calib.txt",
    "euroc": "mav0/cam0/sensor.yaml",
    "scannet": "intrinsic/intrinsic_color.txt",
    "replica": "cam_params.json",
    "colmap": "sparse/0/cameras.txt",
}
"""Files that describe the camera and nothing else, by layout."""
