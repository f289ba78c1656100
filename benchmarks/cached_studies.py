"""Compare studies that compute every run from the pixels with studies that find their stages in the cache.

Each run is done twice, one after the other: without a cache and with it. The trajectories are compared bit for bit.
"""

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.images import DATA_VARIABLE, FIXED_OPTIONS, fountain, in_words, room
from benchmarks.section import Aim, Effort, Section, median
from gtf_tune.definition import GtfDefinition
from gtf_tune.execution import Executor, LocalExecutor, RunLimits, StageCache
from gtf_tune.gtf import GtfSettings, gtf_score
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.study.runs.plan import RunPlanner, SeedSource, run_order
from gtf_tune.trajectory import to_bytes

LIMITS = RunLimits(timeout_s=900.0, memory_bytes=8 * 2**30)
SIGMA = 5.0
CLEAN_RUNS, NOISY_RUNS = 1, 2
FULL_SETTINGS, FULL_RUNS = 13, 8
AIM = 5.0

STUDIES: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "BA threshold": ("mapper.max_normalized_reproj_error", (6e-4, 2e-3, 1e-2, 5e-2)),
    "two-view threshold": ("verification.ransac.max_error", (2.0, 4.0)),
    "SIFT ratio": ("matching.sift.max_ratio", (0.7, 0.8)),
    "SIFT peak threshold": ("extraction.sift.peak_threshold", (0.004, 0.00667)),
}


@dataclass(frozen=True)
class Pair:
    """One run, done without the cache and with it; ``first`` where it was the first one of its image copy."""

    naive: RunOutcome
    cached: RunOutcome
    naive_s: float
    cached_s: float
    first: bool


@dataclass(frozen=True)
class Comparison:
    """All runs of one study."""

    pairs: Sequence[Pair]
    same_bits: bool

    @property
    def ratio(self) -> float:
        """Return how many times cheaper the cached study was."""
        return sum(pair.naive_s for pair in self.pairs) / sum(pair.cached_s for pair in self.pairs)

    def projected(self, settings: int, runs: int) -> float:
        """Return the same for a study of another size, from medians of runs that find their copy and that do not."""
        naive = median([pair.naive_s for pair in self.pairs])
        cold = median([pair.cached_s for pair in self.pairs if pair.first])
        warm = median([pair.cached_s for pair in self.pairs if not pair.first])
        return settings * naive / (cold + (settings - 1) * warm)


def run(effort: Effort) -> Section:
    del effort
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sequence = fountain() or room(folder)
        found = {study: _compared(study, sequence, folder / "cache" / study) for study in STUDIES}
    return Section(
        title="Studies without and with the stage cache",
        text=(
            f"GLOMAP on {in_words(sequence)}, known intrinsics, one thread, one run at a time, each run without and "
            f"with the cache in turn. Small studies are measured: {CLEAN_RUNS} clean and {NOISY_RUNS} noisy runs a "
            f"setting. The last column follows from its median times for {FULL_SETTINGS} settings of {FULL_RUNS} runs. "
            f"The measurement that counts is on fountain-P11, if {DATA_VARIABLE} names its folder."
        ),
        header=("study", "settings", "naive run", "cached run", "measured", "bits", f"{FULL_SETTINGS} settings"),
        rows=tuple(_row(name, one) for name, one in found.items()),
        aims=_aims(sequence, found["BA threshold"]),
        conclusion=_stage_times(found["BA threshold"]),
    )


def _compared(study: str, sequence: ImageSequence, cache: Path) -> Comparison:
    """Compare one study and print its row at once: an interrupted benchmark keeps what it has measured."""
    found = compare(sequence, *STUDIES[study], cache)
    print("  ".join((sequence.name, *_row(study, found))), flush=True)
    return found


def compare(sequence: ImageSequence, option: str, values: Sequence[float], cache: Path) -> Comparison:
    """Do every run of a study on one option without the cache and with it, in turn."""
    pipeline = create_pipeline("glomap")
    planner = RunPlanner(pipeline, GtfDefinition(), SeedSource(0), FIXED_OPTIONS)
    order = run_order(CLEAN_RUNS, NOISY_RUNS)
    pairs: list[Pair] = []
    scores: list[tuple[float, float]] = []
    with (
        LocalExecutor(scratch=cache / "naive") as naive,
        LocalExecutor(scratch=cache / "scratch", stages=StageCache(cache)) as cached,
    ):
        _warm_up(naive, cached)
        for number, value in enumerate(values):
            these = [
                _pair(
                    planner.request(sequence, {option: value}, one, sigma=SIGMA, number=0), naive, cached, number == 0
                )
                for one in order
            ]
            pairs += these
            scores.append((_score(order, [one.naive for one in these]), _score(order, [one.cached for one in these])))
    same = all(to_bytes(pair.naive.trajectory) == to_bytes(pair.cached.trajectory) for pair in pairs)
    return Comparison(pairs, same and all(first == second for first, second in scores))


def _pair(request: RunRequest, naive: Executor, cached: Executor, first: bool) -> Pair:
    outcome_naive, naive_s = _timed(naive, request)
    outcome_cached, cached_s = _timed(cached, request)
    return Pair(outcome_naive, outcome_cached, naive_s, cached_s, first)


def _timed(executor: Executor, request: RunRequest) -> tuple[RunOutcome, float]:
    began = time.perf_counter()
    outcome = executor.submit(request, LIMITS).result()
    return outcome, time.perf_counter() - began


def _warm_up(*executors: Executor) -> None:
    """Let worker processes import the pipeline before anything is timed."""
    from gtf_tune.pipelines.analytic import imaginary_sequence

    planner = RunPlanner(create_pipeline("analytic"), GtfDefinition(), SeedSource(0), {})
    request = planner.request(imaginary_sequence(10), {}, ("clean", 0), sigma=0.0, number=0)
    for executor in executors:
        executor.submit(request, LIMITS).result()


def _score(order: Sequence[tuple[RunKind, int]], outcomes: Sequence[RunOutcome]) -> float:
    clean = [one.trajectory for (kind, _), one in zip(order, outcomes, strict=True) if kind == "clean"]
    noisy = [one.trajectory for (kind, _), one in zip(order, outcomes, strict=True) if kind == "noisy"]
    return gtf_score(clean, noisy, GtfSettings(), num_frames=max(map(len, clean))).value


def _row(name: str, found: Comparison) -> tuple[str, ...]:
    warm = median([pair.cached_s for pair in found.pairs if not pair.first])
    return (
        name,
        str(len(found.pairs) // (CLEAN_RUNS + NOISY_RUNS)),
        f"{median([pair.naive_s for pair in found.pairs]):.2f} s",
        f"{warm:.2f} s",
        f"{found.ratio:.1f} x",
        "same" if found.same_bits else "DIFFERENT",
        f"{found.projected(FULL_SETTINGS, FULL_RUNS):.1f} x",
    )


def _aims(sequence: ImageSequence, found: Comparison) -> tuple[Aim, ...]:
    projected = found.projected(FULL_SETTINGS, FULL_RUNS)
    warm = median([pair.cached_s for pair in found.pairs if not pair.first])
    naive = median([pair.naive_s for pair in found.pairs])
    bound = (
        f"What cannot be cached takes {warm:.1f} s of {naive:.1f} s a run, so no study can get beyond "
        f"{naive / warm:.1f} x."
    )
    return (
        Aim(
            wanted=f"a BA-threshold study at least {AIM:g} x cheaper on fountain-P11",
            measured=f"{projected:.1f} x on {sequence.name}",
            met=projected >= AIM,
            bound="" if projected >= AIM else bound,
        ),
    )


def _stage_times(found: Comparison) -> str:
    """Say where the time of a naive run goes, from the diagnostics of its stages."""
    names = sorted({name for pair in found.pairs for name in pair.naive.diagnostics if name.endswith("_s")})
    parts = [
        (name[:-2], median([float(pair.naive.diagnostics.get(name, 0.0)) for pair in found.pairs])) for name in names
    ]
    listed = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in sorted(parts, key=lambda part: -part[1]))
    return f"Median seconds of the stages of a naive run: {listed}."
