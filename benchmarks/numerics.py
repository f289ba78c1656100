"""Put the measurements of the metric kernel and of the noise into the performance page."""

import tempfile
from pathlib import Path

from benchmarks import metric_kernel, noise_throughput
from benchmarks.section import Aim, Effort, Section

METRIC_AIM, DIFFERENCE_AIM = 200.0, 1e-9


def run_metric(effort: Effort) -> Section:
    del effort
    rows = [metric_kernel.measure(*size) for size in metric_kernel.SIZES]
    least = min(row.ratio for row in rows)
    difference = max(row.largest_relative_difference for row in rows)
    return Section(
        title="Metric kernel against evo",
        text=(
            f"ATE after Sim(3) alignment of all pairs of k clean and k_delta noisy trajectories of "
            f"{metric_kernel.POSES:,} poses, batched, against evo pair by pair, in turns in one process, medians of "
            f"{metric_kernel.ROUNDS}. The whole score adds coverage, collapse and confidence interval."
        ),
        header=("pairs", "evo", "kernel", "whole score", "evo / kernel", "largest relative difference"),
        rows=tuple(
            (
                f"{row.clean} x {row.noisy}",
                f"{row.evo_s * 1e3:.0f} ms",
                f"{row.kernel_s * 1e3:.2f} ms",
                f"{row.score_s * 1e3:.2f} ms",
                f"{row.ratio:.0f} x",
                f"{row.largest_relative_difference:.1e}",
            )
            for row in rows
        ),
        aims=(
            Aim(
                wanted=f"at least {METRIC_AIM:g} x evo at most {DIFFERENCE_AIM:g} relative difference",
                measured=f"{least:.0f} x at {difference:.1e}",
                met=least >= METRIC_AIM and difference <= DIFFERENCE_AIM,
                bound=""
                if least >= METRIC_AIM
                else "The kernel is bound by reading the poses of every pair from memory; evo by its Python objects.",
            ),
        ),
    )


def run_noise(effort: Effort) -> Section:
    del effort
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sequence = noise_throughput.make_sequence(folder / "images")
        speeds = noise_throughput.measure_speeds(sequence, folder)
        features_ms = noise_throughput.measure_features_ms(sequence, folder)
        gain = noise_throughput.thread_gain(sequence, folder)
    noisy = next(speed for speed in speeds if speed.name == "gtf-tune, noisy")
    return Section(
        title="Noisy images",
        text=(
            f"{noise_throughput.IMAGES} images of {noise_throughput.WIDTH}x{noise_throughput.HEIGHT}, processor time "
            f"per image on one thread, in turns, medians of {noise_throughput.ROUNDS}."
        ),
        header=("way", "an image", "images a second", "against the plain loop", "against a copy"),
        rows=tuple(
            (
                speed.name,
                f"{speed.milliseconds:.2f} ms",
                f"{speed.images_per_s:.0f}",
                f"{speed.over_plain_loop:.2f} x",
                f"{speed.share_of_copy:.2f} x",
            )
            for speed in speeds
        ),
        aims=(
            Aim(
                wanted="noise costs less than the features read from the images",
                measured=f"{noisy.milliseconds / features_ms:.1%} of the {features_ms:.0f} ms that SIFT takes",
                met=noisy.milliseconds < features_ms,
            ),
        ),
        conclusion=f"Two threads write {gain:.2f} times as fast as one, by the wall clock.",
    )
