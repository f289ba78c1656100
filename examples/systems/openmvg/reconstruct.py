"""Reconstruct a folder of images by OpenMVG, as the package openmvg-rs has it: what `openmvg.toml` starts."""

import argparse
from pathlib import Path

import openmvg_rs

parser = argparse.ArgumentParser()
parser.add_argument("images", type=Path)
parser.add_argument("model", type=Path, help="folder of the COLMAP model that is written: FOLDER/sparse/0")
parser.add_argument("--camera", help="fx,fy,cx,cy in pixels, the first of which is centred at (0, 0)")
parser.add_argument("--seed", type=int)
parser.add_argument("--threads", type=int)
parser.add_argument("--engine", default="incremental")
parser.add_argument("--features", default="alp")
given = parser.parse_args()

calibration = None
if given.camera:
    fx, fy, cx, cy = map(float, given.camera.split(","))
    calibration = Path("K.txt")
    calibration.write_text(f"{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n")
scene = openmvg_rs.reconstruct(
    given.images,
    engine=given.engine,
    extraction_method=given.features,
    seed=given.seed,
    intrinsics=calibration,
    progress=False,
    max_workers=given.threads,
)
scene.write_colmap(given.model.parents[1])
