"""Split GLOMAP's mapping after global positioning, without changing a bit of its result.

GLOMAP averages rotations, builds tracks, solves for all positions, filters, and then refines by bundle adjustment and
retriangulation (COLMAP's ``src/colmap/sfm/global_mapper.cc``). The first half takes up to two thirds of the time and
does not depend on the options of the second. `store_positions` runs the first half alone and keeps poses and points;
`map_from_positions` runs the whole mapper with the position solver given nothing to solve, and puts the stored state
in place when the mapper reports that positions are done.

Equal bits need two things. Points must be stored in the mapper's own hash table in the same order as the uninterrupted
run has them, because Ceres sums in that order: chains of the table are prepended to, so points are added last first.
And ``max_normalized_reproj_error`` must not be part of the stored state: the first half runs without that filter,
which is the last thing it does to points, and the second half applies it (ten times the option's value, as GLOMAP
does). Wherever this does not work out (several components, a mapper that failed or behaves differently),
`SplitRefused` says so and the mapper runs in one piece.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from gtf_tune.pipelines.options import OptionValue
from gtf_tune.trajectory import FloatArray, IntArray

_FILE = "positions.npz"
_NO_LIMIT = 1e6
_NO_TRACK_IS_THIS_LONG = 2**31 - 1
_POSITIONING_FILTER_FACTOR = 10.0

_USED_LATER = (
    "mapper.ba_",
    "mapper.bundle_adjustment.",
    "mapper.max_normalized_reproj_error",
    "mapper.retriangulation.",
    "mapper.skip_bundle_adjustment",
    "mapper.skip_retriangulation",
)


class SplitRefused(Exception):
    """Signal that mapping cannot be resumed from stored positions and has to run in one piece."""


@dataclass(frozen=True)
class _State:
    """A reconstruction after global positioning.

    ``quaternions`` (f, 4) xyzw and ``translations`` (f, 3) are rig_from_world of the frames ``frame_ids`` (f,).
    ``point_ids`` (p,) are in the order of the mapper's table, ``points`` (p, 3) in its world frame. ``track_ends`` (p,)
    cut ``observations`` (o, 2), which are (image id, keypoint index), into tracks.
    """

    frame_ids: IntArray
    quaternions: FloatArray
    translations: FloatArray
    point_ids: IntArray
    points: FloatArray
    track_ends: IntArray
    observations: IntArray


def positioning_options(options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
    """Return the mapping options on which the positions depend."""
    return {name: value for name, value in options.items() if not name.startswith(_USED_LATER)}


def store_positions(options: Any, database: Any, folder: Path) -> None:
    """Run the mapper up to global positioning and keep its state, or nothing where there is not exactly one."""
    half = copy.deepcopy(options)
    half.mapper.max_normalized_reproj_error = _NO_LIMIT
    half.mapper.skip_bundle_adjustment = True
    half.mapper.skip_retriangulation = True
    states: list[_State] = []
    _run(half, database, lambda model: states.append(_read_state(model)))
    if len(states) == 1 and len(states[0].point_ids):
        np.savez(folder / _FILE, **vars(states[0]))


def map_from_positions(options: Any, database: Any, folder: Path) -> list[Any]:
    """Return the models of a whole mapper run that takes its positions from the folder.

    Raises
    ------
    SplitRefused
        There is no stored state, or it does not fit what the mapper has.
    """
    if not (folder / _FILE).exists():
        raise SplitRefused("the mapper did not come to exactly one set of positions")
    with np.load(folder / _FILE) as stored:
        state = _State(**stored)
    threshold = _POSITIONING_FILTER_FACTOR * options.mapper.max_normalized_reproj_error
    rest = copy.deepcopy(options)
    rest.mapper.global_positioning.min_num_view_per_track = _NO_TRACK_IS_THIS_LONG
    resumed: list[Any] = []

    def resume(model: Any) -> None:
        if not resumed:
            _write_state(model, state)
            _filter_normalized(model, threshold)
            resumed.append(model)

    models = _run(rest, database, resume)
    if len(resumed) != 1 or len(models) > 1:
        raise SplitRefused("the mapper found several components")
    return models


def _run(options: Any, database: Any, on_update: Callable[[Any], None]) -> list[Any]:
    """Run the mapper, handing over the model whenever it changes; the first time is after global positioning."""
    manager = pycolmap.ReconstructionManager()
    pipeline = pycolmap.GlobalPipeline(options, database, manager)
    pipeline.add_callback(
        pycolmap.GlobalPipelineCallback.MODEL_UPDATE_CALLBACK, lambda: on_update(manager.get(manager.size() - 1))
    )
    pipeline.run()
    return [manager.get(index) for index in range(manager.size())]


def _read_state(model: Any) -> _State:
    frames = [model.frames[frame_id] for frame_id in sorted(model.reg_frame_ids())]
    points = list(model.points3D.items())
    tracks = [point.track.elements for _, point in points]
    return _State(
        frame_ids=np.array([frame.frame_id for frame in frames], dtype=np.int64),
        quaternions=np.array([frame.rig_from_world.rotation.quat for frame in frames]).reshape(-1, 4),
        translations=np.array([frame.rig_from_world.translation for frame in frames]).reshape(-1, 3),
        point_ids=np.array([one for one, _ in points], dtype=np.int64),
        points=np.array([point.xyz for _, point in points]).reshape(-1, 3),
        track_ends=np.cumsum([len(track) for track in tracks], dtype=np.int64),
        observations=np.array(
            [(element.image_id, element.point2D_idx) for track in tracks for element in track], dtype=np.int64
        ).reshape(-1, 2),
    )


def _write_state(model: Any, state: _State) -> None:
    if sorted(model.reg_frame_ids()) != state.frame_ids.tolist():
        raise SplitRefused("the mapper registered other frames than those stored")
    for point_id in list(model.points3D):
        model.delete_point3D(point_id)
    for frame_id, quaternion, translation in zip(state.frame_ids, state.quaternions, state.translations, strict=True):
        model.frames[frame_id].rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(quaternion), translation)
    tracks = np.split(state.observations, state.track_ends[:-1])
    for point_id, xyz, track in zip(reversed(state.point_ids), reversed(state.points), reversed(tracks), strict=True):
        model.add_point3D_with_id(point_id, _point(xyz, track))
    if list(model.points3D) != state.point_ids.tolist():
        raise SplitRefused("this pycolmap keeps points in an order of its own")


def _point(xyz: FloatArray, observations: IntArray) -> Any:
    point = pycolmap.Point3D()
    point.xyz = xyz
    track = pycolmap.Track()
    for image_id, keypoint in observations.tolist():
        track.add_element(image_id, keypoint)
    point.track = track
    return point


def _filter_normalized(model: Any, threshold: float) -> None:
    pycolmap.ObservationManager(model).filter_points3D_with_large_reprojection_error(
        threshold, set(model.point3D_ids()), pycolmap.ReprojectionErrorType.NORMALIZED
    )
