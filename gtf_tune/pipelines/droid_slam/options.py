"""List the options of DROID-SLAM with the defaults of its demo.

Source: https://github.com/princeton-vl/DROID-SLAM/blob/2dfd39f/demo.py, and droid_slam/droid_frontend.py for
``motion_damping``, which the demo leaves at 0.
"""

from collections.abc import Mapping
from types import MappingProxyType

from gtf_tune.pipelines.options import OptionSpec

_SPECS = (
    OptionSpec("beta", 0.3, "Weight of the translation against the rotation part of the flow.", low=0.0, high=1.0),
    OptionSpec("filter_thresh", 2.4, "Motion (pixels at 1/8 size) before a frame is a candidate keyframe.", low=0.0),
    OptionSpec("warmup", 8, "Keyframes before the first optimisation.", low=4, high=100),
    OptionSpec("keyframe_thresh", 4.0, "Distance below which a keyframe is removed again.", low=0.0),
    OptionSpec("frontend_thresh", 16.0, "Distance within which frames of the window get an edge.", low=0.0),
    OptionSpec("frontend_window", 25, "Keyframes in the window of local optimisation.", low=5),
    OptionSpec("frontend_radius", 2, "Neighbours in time that always get an edge, in the window.", low=0),
    OptionSpec("frontend_nms", 1, "Non-maximum suppression of edges, in the window.", low=0),
    OptionSpec("backend_thresh", 22.0, "Distance within which any two keyframes get an edge.", low=0.0),
    OptionSpec("backend_radius", 2, "Neighbours in time that always get an edge, in global optimisation.", low=0),
    OptionSpec("backend_nms", 3, "Non-maximum suppression of edges, in global optimisation.", low=0),
    OptionSpec("motion_damping", 0.0, "Share of the last motion that is predicted again; below 0 none.", high=1.0),
    OptionSpec("buffer", 512, "Largest number of keyframes; GPU memory grows with it.", low=32),
    OptionSpec("stride", 1, "Track every n-th frame; all others get poses at the end.", low=1),
    OptionSpec("upsample", False, "Whether to estimate depth at full resolution."),
    OptionSpec("asynchronous", False, "Whether global optimisation runs beside tracking; not deterministic."),
)

OPTIONS: Mapping[str, OptionSpec] = MappingProxyType({spec.name: spec for spec in _SPECS})
"""Every option by its name, which is that of the demo's flag."""
