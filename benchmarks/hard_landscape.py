"""Make the search of the analytic pipeline hard: a bent valley, ripples, plateaus, and a forbidden region nearby."""

import math
from collections.abc import Mapping

from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.analytic import OPTIMUM, SETTINGS, VERSION, AnalyticPipeline

_BEST_ERROR_M = 1e-3
_LOST = 0.3
_DEFAULTS: Mapping[str, OptionValue] = {
    name: spec.default for name, spec in AnalyticPipeline("analytic", VERSION, {}).options.specs.items()
}


class HardPipeline(AnalyticPipeline):
    """Give errors whose optimum is where the smooth pipeline has its own, but is reached less easily.

    The best filter depends on the robust scale along a bent valley with ripples; the scale does nothing without a
    robust kernel; far ratios and lengths are all equally bad; a strict filter with a strict ratio loses frames.
    """

    def expected_error(self, options: Mapping[str, OptionValue]) -> float:
        full = {**_DEFAULTS, **options}
        filtering, scale, ratio, length = _places(full)
        cost = 0.0
        if full["robust.kernel"] == "trivial":
            cost, scale = 0.5, 1.0
        elif full["robust.kernel"] == "huber":
            cost = 0.1
        cost += 0.8 * (filtering - 0.5 * scale**2 + 0.4 * scale) ** 2 + 0.2 * scale**2
        cost += 0.05 * (1.0 - math.cos(3.0 * math.pi * scale))
        cost += 0.4 * (1.0 - math.exp(-(ratio**2))) + 0.2 * (1.0 - math.exp(-((length / 2.0) ** 2)))
        return _BEST_ERROR_M * math.exp(min(cost + (0.15 if full["refine.intrinsics"] else 0.0), 4.0))

    def missing_share(self, options: Mapping[str, OptionValue]) -> float:
        filtering, _, ratio, _ = _places({**_DEFAULTS, **options})
        return _LOST if filtering + 0.8 * ratio < -0.4 else 0.0


def hard_pipeline() -> HardPipeline:
    return HardPipeline("analytic", VERSION, {name: setting.default for name, setting in SETTINGS.items()})


def _places(options: Mapping[str, OptionValue]) -> tuple[float, float, float, float]:
    filtering, scale = (
        math.log10(float(options[name]) / float(OPTIMUM[name])) for name in ("filter.max_error", "robust.scale")
    )
    ratio = (float(options["matching.max_ratio"]) - float(OPTIMUM["matching.max_ratio"])) / 0.1
    length = float(options["tracks.min_length"]) - float(OPTIMUM["tracks.min_length"])
    return filtering, scale, ratio, length
