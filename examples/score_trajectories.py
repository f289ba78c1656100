"""Score my trajectories: how precise a program is, by what it made of clean and of noisy images.

    python examples/score_trajectories.py "runs/clean*" "runs/noisy*"

Each argument is a trajectory file (TUM, KITTI, EuRoC), a COLMAP model, a folder of them, or a glob pattern. Nothing is
run and nothing is stored.
"""

import sys

import gtf_tune as gtf


def main(clean: str, noisy: str) -> None:
    """Print the score, which run moved most, and which runs could not be compared."""
    clean_runs, noisy_runs = gtf.load_trajectories(clean), gtf.load_trajectories(noisy)
    score = gtf.gtf_ate(clean_runs, noisy_runs)
    print(score)
    for name, errors, fell_apart in zip(score.noisy, score.matrix.T, score.collapsed, strict=True):
        note = "  fell apart" if fell_apart else ""
        print(f"{name}: moved by {1000 * errors.mean():.2f} per mille of the extent{note}")
    for (i, j), reason in score.pair_errors.items():
        print(f"{score.clean[i]} and {score.noisy[j]}: {reason}")


if __name__ == "__main__":
    main(*sys.argv[1:] or ("clean/", "noisy/"))
