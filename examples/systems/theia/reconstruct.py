"""Reconstruct a folder of images by Theia, as the package pytheia has it: the two steps of `theia.toml`.

Usage: reconstruct.py match IMAGES STATE [--OPTION=VALUE ...]
       reconstruct.py map STATE TRAJECTORY --size=W,H [--camera=FX,FY,CX,CY] [--OPTION=VALUE ...]
"""

import argparse
import json
import sys
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytheia

ESTIMATORS = {
    "global": pytheia.sfm.GlobalReconstructionEstimator,
    "incremental": pytheia.sfm.IncrementalReconstructionEstimator,
    "hybrid": pytheia.sfm.HybridReconstructionEstimator,
}


def match(images: Path, state: Path, max_features: int, contrast_threshold: float, max_ratio: float) -> None:
    """Write the positions of matched SIFT features of each pair of images."""
    sift = cv2.SIFT_create(max_features, contrastThreshold=contrast_threshold)
    pictures = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(images.iterdir())]
    features = [sift.detectAndCompute(picture, None) for picture in pictures]
    pairs = {}
    for first, second in combinations(range(len(features)), 2):
        (points, descriptors), (others, other_descriptors) = features[first], features[second]
        if descriptors is None or other_descriptors is None or min(len(points), len(others)) < 2:
            continue
        nearest = cv2.BFMatcher().knnMatch(descriptors, other_descriptors, k=2)
        good = [best for best, next_best in nearest if best.distance < max_ratio * next_best.distance]
        pairs[f"{first} {second}"] = np.array([points[m.queryIdx].pt + others[m.trainIdx].pt for m in good])
    np.savez(state / "matches.npz", num_images=len(pictures), **pairs)


def calibration(width: int, height: int, camera: str) -> "pytheia.sfm.CameraIntrinsicsPrior":
    """Return what is known of the camera; the centre of the first pixel is at (0, 0), as OpenCV's features have it."""
    prior = pytheia.sfm.CameraIntrinsicsPrior()
    prior.image_width, prior.image_height = width, height
    prior.camera_intrinsics_model_type = "PINHOLE"
    fx, fy, cx, cy = (
        map(float, camera.split(","))
        if camera
        else [1.2 * max(width, height)] * 2 + [width / 2 - 0.5, height / 2 - 0.5]
    )
    prior.focal_length.value, prior.aspect_ratio.value = [fx], [fy / fx]
    prior.principal_point.value = [cx, cy]
    prior.skew.value = [0.0]
    return prior


def add_pairs(matches: dict, views: list[int], prior: object, given: dict) -> tuple:
    """Return the view graph of verified pairs and the tracks of their matches."""
    two_views = pytheia.sfm.EstimateTwoViewInfoOptions()
    two_views.max_sampson_error_pixels = given["max_sampson_error_pixels"]
    graph, tracks = pytheia.sfm.ViewGraph(), pytheia.sfm.TrackBuilder(2, len(views))
    for pair, rows in matches.items():
        first, second = (views[int(index)] for index in pair.split())
        links = [
            pytheia.matching.FeatureCorrespondence(pytheia.sfm.Feature(row[:2]), pytheia.sfm.Feature(row[2:]))
            for row in rows
        ]
        if len(links) < given["min_num_two_view_inliers"]:
            continue
        found, info, inliers = pytheia.sfm.EstimateTwoViewInfo(two_views, prior, prior, links)
        if found and len(inliers) >= given["min_num_two_view_inliers"]:
            graph.AddEdge(first, second, info)
            for index in inliers:
                tracks.AddFeatureCorrespondence(first, links[index].feature1, second, links[index].feature2)
    return graph, tracks


def reconstruct(state: Path, output: Path, prior: object, fixed: bool, given: dict, threads: int) -> None:
    """Write index, centre and quaternion of each image that Theia gave a pose, in the frame of the world."""
    matches = dict(np.load(state / "matches.npz"))
    model = pytheia.sfm.Reconstruction()
    views = [model.AddView(str(index), 0, index) for index in range(int(matches.pop("num_images")))]
    for view in views:
        model.MutableView(view).SetCameraIntrinsicsPrior(prior)
    pytheia.sfm.SetCameraIntrinsicsFromPriors(model)
    graph, tracks = add_pairs(matches, views, prior, given)
    tracks.BuildTracks(model)
    options = pytheia.sfm.ReconstructionEstimatorOptions()
    options.num_threads = threads
    if fixed:
        options.intrinsics_to_optimize = pytheia.sfm.OptimizeIntrinsicsType.NONE
    for name, value in given.items():
        if hasattr(options, name):
            kind = type(getattr(options, name))
            setattr(options, name, getattr(kind, value) if isinstance(value, str) else value)
    summary = ESTIMATORS[given["method"]](options).Estimate(graph, model)
    if not summary.success:
        sys.exit(f"Theia found no reconstruction: {summary.message}")
    with output.open("w") as file:
        for index, view in enumerate(views):
            if view in summary.estimated_views:
                camera = model.View(view).Camera()
                vector = cv2.Rodrigues(camera.GetOrientationAsRotationMatrix().T)[0][:, 0]
                angle = np.linalg.norm(vector)
                quaternion = *(vector * np.sinc(angle / 2 / np.pi) / 2), np.cos(angle / 2)
                file.write(" ".join(map(str, (index, *camera.GetPosition(), *quaternion))) + "\n")


def value_of(word: str) -> float | int | str:
    """Return the number that a word stands for, or the word."""
    try:
        return json.loads(word)
    except ValueError:
        return word


def main() -> None:
    """Run one step; options have the names of Theia's own."""
    parser = argparse.ArgumentParser()
    parser.add_argument("step", choices=["match", "map"])
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--size")
    parser.add_argument("--camera", default="")
    parser.add_argument("--threads", type=int)
    given, words = parser.parse_known_args()
    options = {name: value_of(value) for name, value in (word.removeprefix("--").split("=", 1) for word in words)}
    if given.step == "match":
        match(given.source, given.target, **options)
    else:
        prior = calibration(*map(int, given.size.split(",")), given.camera)
        reconstruct(given.source, given.target, prior, bool(given.camera), options, given.threads)


if __name__ == "__main__":
    main()
