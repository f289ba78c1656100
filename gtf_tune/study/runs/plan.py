"""Say which runs score a setting."""

from collections.abc import Mapping
from dataclasses import dataclass

from gtf_tune.definition import GtfDefinition
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.pipelines.run import RunKind, RunRequest
from gtf_tune.sequence import Sequence
from gtf_tune.study.runs.seeds import SeedSource


@dataclass(frozen=True)
class RunPlanner:
    """Turn options into run requests.

    Clean run ``i`` and noisy run ``j`` of a sequence have the same seeds and the same noise in every trial (common
    random numbers: trials then differ by their options only), unless the definition asks for independent draws.
    """

    pipeline: Pipeline
    gtf: GtfDefinition
    seeds: SeedSource
    fixed_options: Mapping[str, OptionValue]

    def request(
        self,
        sequence: Sequence,
        options: Mapping[str, OptionValue],
        run: tuple[RunKind, int],
        *,
        sigma: float,
        number: int,
    ) -> RunRequest:
        """Return the request for one run of a trial; ``sigma`` is in grey levels and ignored by clean runs."""
        kind, index = run
        noisy = kind == "noisy"
        salt = None if self.gtf.common_noise else number
        return RunRequest(
            pipeline=self.pipeline,
            options=self.effective_options(options),
            sequence=sequence,
            kind=kind,
            index=index,
            noise_sigma=sigma if noisy else 0.0,
            noise_seed=self.seeds.noise_seed(sequence.fingerprint, index, salt) if noisy else 0,
            seed=self.seeds.run_seed(sequence.fingerprint, kind, index, salt),
        )

    def effective_options(self, options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
        """Return fixed and chosen options that differ from the defaults; what equals a default changes no run."""
        table = self.pipeline.options
        checked = table.check({**self.fixed_options, **options})
        return {name: value for name, value in checked.items() if value != table.specs[name].default}


def run_order(clean_runs: int, noisy_runs: int) -> list[tuple[RunKind, int]]:
    """Return the runs of one sequence in the order in which they count: clean ones first."""
    clean: list[tuple[RunKind, int]] = [("clean", index) for index in range(clean_runs)]
    return clean + [("noisy", index) for index in range(noisy_runs)]
