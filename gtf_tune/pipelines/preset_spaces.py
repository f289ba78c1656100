"""Read the default search spaces: one file for each pipeline, with the reason and the source of each range."""

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from importlib.resources import files
from types import MappingProxyType
from typing import Any

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.options import OptionValue

DEFAULT_TIER = 1


@dataclass(frozen=True)
class PresetOption:
    """One option that a preset searches.

    ``axis`` is its axis as a study definition has it. ``tier`` says what a trial repeats: 1 mapping only, 2 also
    verification, 3 everything. ``unit`` is "pixels" where the range belongs to full-size images.
    ``unknown_intrinsics`` is true for one that has an effect only where the intrinsics are unknown.
    """

    name: str
    tier: int
    axis: Mapping[str, object]
    unit: str
    reason: str
    source: str
    unknown_intrinsics: bool = False


@dataclass(frozen=True)
class Preset:
    """A name for the options up to a tier, with the ``margin`` that one of that tier has to win before it is adopted.

    The margin is a share of the score.
    """

    name: str
    tier: int
    margin: float
    reason: str


@dataclass(frozen=True)
class Baseline:
    """A configuration that users have beside the program's defaults."""

    name: str
    options: Mapping[str, OptionValue]
    source: str


@dataclass(frozen=True)
class Lead:
    """One of the first configurations that was best on most measured sequences.

    Another one is only preferred where its score is smaller by the ``margin``, a share of it.
    """

    options: Mapping[str, OptionValue]
    margin: float
    source: str


@dataclass(frozen=True)
class PresetSpace:
    """The search spaces that a pipeline has by default, the ``presets``.

    ``first`` are the configurations that are tried first, each as the options that differ from nominal.
    """

    pipeline: str
    presets: tuple[Preset, ...]
    options: tuple[PresetOption, ...]
    first: tuple[Mapping[str, OptionValue], ...]
    baselines: tuple[Baseline, ...]
    lead: Lead | None = None

    def axes(self, tier: int = DEFAULT_TIER, *, unknown_intrinsics: bool = False) -> dict[str, Mapping[str, object]]:
        """Return the axes of the options up to a tier that have an effect, as a study definition has them."""
        return {
            option.name: option.axis
            for option in self.options
            if option.tier <= tier and option.unknown_intrinsics <= unknown_intrinsics
        }

    def depends_on_intrinsics(self, tier: int) -> bool:
        """Whether options up to a tier have an effect only where the intrinsics are unknown."""
        return self.axes(tier) != self.axes(tier, unknown_intrinsics=True)

    def tier(self, name: str) -> int:
        """Return the tier of the preset with a name.

        Raises
        ------
        DefinitionError
            There is none.
        """
        tiers = {preset.name: preset.tier for preset in self.presets}
        if name not in tiers:
            raise DefinitionError(
                f"pipeline '{self.pipeline}' has no preset '{name}', only {', '.join(tiers)}; take one of them",
                remedy=("presets", self.pipeline),
            )
        return tiers[name]

    def margins(self, space: Collection[str]) -> dict[str, float]:
        """Return the margin of each searched option that repeats more than mapping."""
        known = {preset.tier: preset.margin for preset in self.presets}
        return {
            option.name: known[option.tier]
            for option in self.options
            if option.name in space and option.tier > DEFAULT_TIER
        }

    def search(self, space: Collection[str], fixed: Collection[str] = ()) -> dict[str, Any]:
        """Return what a study that searches ``space`` tries first, and its baselines, as a definition has them.

        Configurations with other options than those are left out, and baselines with options held ``fixed``.
        """
        baselines = {baseline.name: dict(baseline.options) for baseline in self.baselines}
        return {
            "first": [dict(options) for options in self.first if set(options) <= set(space)],
            "baselines": {name: options for name, options in baselines.items() if not set(options) & set(fixed)},
        }


def preset_pipelines() -> list[str]:
    """Return the names of the pipelines that have a preset, sorted."""
    folder = files("gtf_tune.pipelines") / "spaces"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def preset_space(pipeline: str) -> PresetSpace:
    """Return the preset of a pipeline.

    Raises
    ------
    DefinitionError
        The pipeline has none.
    """
    known = preset_pipelines()
    if pipeline not in known:
        raise DefinitionError(
            f"nothing says what to search on pipeline '{pipeline}'; name the options (presets: {', '.join(known)})"
        )
    text = (files("gtf_tune.pipelines") / "spaces" / f"{pipeline}.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text)
    return PresetSpace(
        pipeline,
        tuple(Preset(**entry) for entry in data["presets"]),
        tuple(_option(entry) for entry in data["options"]),
        tuple(data.get("first", ())),
        tuple(Baseline(entry["name"], entry["options"], entry["source"]) for entry in data.get("baselines", ())),
        Lead(**data["lead"]) if "lead" in data else None,
    )


def searched_options(pipeline: str) -> dict[str, PresetOption]:
    """Return the options that the preset of a pipeline searches, by name; none where it has no preset."""
    options = preset_space(pipeline).options if pipeline in preset_pipelines() else ()
    return {option.name: option for option in options}


def preset_search(
    pipeline: str, space: Collection[str], section: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """Return what a study of a pipeline tries first and its baselines, as `PresetSpace.search`; nothing without preset.

    ``section`` is the pipeline's part of the definition: what it holds fixed is respected.
    """
    if pipeline not in preset_pipelines():
        return {}
    return preset_space(pipeline).search(space, {**section.get("options", {}), **section.get("nominal", {})})


def _option(data: Mapping[str, Any]) -> PresetOption:
    axis = data["range"] if "range" in data else {"values": data["values"]}
    given = {key: value for key, value in data.items() if key not in ("range", "values")}
    return PresetOption(**{"unit": "", **given}, axis=axis)
