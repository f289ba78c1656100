"""What stands above each table of docs/results-appendix.md."""

from types import MappingProxyType

from experiments import joint, ladder, several
from experiments.ablation import WITHOUT_EFFECT, WITHOUT_SUCCESSOR, pairs
from experiments.findings import WORTH_FINDING
from experiments.plan import AGGREGATE, OPTIONS

FIGURES = MappingProxyType(
    {
        "gains": "Change of the true ATE at the pick, after confirmation and at the oracle, for each grid",
        "k-delta": "R2 between score and true ATE over the number of noisy runs",
        "noise": "Score of the nominal setting over the noise level",
        "options": "Range of the true ATE over the values of each option",
    }
)

TABLE_2 = (
    "In each cell: what GTF ATE picks, what confirmation made of it, and what ground truth would have picked, as "
    f"changes of the true ATE against nominal (negative is better). The pick is by `{AGGREGATE}`, the default."
)
FRESH = (
    "The runs that confirmations were decided on, by scores alone, judged by ground truth afterwards: every candidate "
    "beside nominal under the same noise, on images that the search never saw. The geometric mean of the ratios of "
    "true ATEs, without runs far from the others, and its 95 % interval. Score and true ATE share these runs, so what "
    "was adopted may have had luck in both; the last column is one draw of other images, the clean ones."
)
PAPER = "Changes of the true ATE by GTF ATE and, in brackets, by ground truth, as printed; negative is better."
AGGREGATES = (
    'Averages over all experiments. "share of the oracle" is the part of the possible gain that the pick reaches, over '
    f"experiments where ground truth gains more than {WORTH_FINDING:.0%} (a loss counts as -100 % at the most); "
    '"regressions" counts unconfirmed picks that are worse than nominal by more than 1 %. R2 counts with the sign of '
    "the correlation. Besides the aggregates of the matrix: `paired` is the geometric mean of errors relative to "
    "nominal's under the same noise, without instances far from the others (what confirmation tests); `noisy-noisy` "
    "the median error of noisy runs against each other; `dispersion` the median distance of all runs from their "
    "Procrustes consensus; `clean-clean` the error of clean runs against each other; `reprojection` the mean "
    "reprojection error. All of them use the same runs. "
    '"share on unseen images" is that part where half of the noisy runs choose and ground truth judges the other half '
    "(see below)."
)
WEAKER = (
    f"Grids of table 2 again, under noise of fewer grey levels: rank correlation of the score (`{AGGREGATE}`) with the "
    "true ATE, and the change of the true ATE at the pick and at what a confirmation adopted, under either noise. The "
    "true ATE is that of the clean runs, which are the same under both. The noise ladders below say what "
    '`noise_sigma = "auto"`, the default of studies, takes on each sequence.'
)
WEAKER_PREDICTORS = "The same grids under the weaker noise; cells as in the table of every experiment."
PICKS = (
    "For each experiment 200 random choices of half of its noisy runs: change of the true ATE at the pick on average / "
    "in the worst tenth / share of picks worse than nominal by more than 1 %."
)
PREDICTORS = (
    "R2 of a line through predictor and true ATE with the sign of the correlation, Spearman's rank correlation, and "
    "the change of the true ATE at the pick."
)
SHORTFALL = (
    f"Experiments whose pick (aggregate `{AGGREGATE}`) misses the oracle by more than 1 % of the true ATE. The gap "
    "compares the scores of both settings, paired by noise instance, without collapsed ones; its 95 % interval stands "
    "in brackets. Where it is certain and positive, more noisy runs do not help: the score prefers another setting "
    "than the truth does. Where it is certain and negative, pairs find what the aggregate missed. Otherwise the last "
    "column says how many runs would settle which of the two the score prefers (power 80 %)."
)
UNSEEN = (
    "Ground truth judges clean runs above, and those are one draw: where settings are near, the same settings rank "
    "differently on the next images. So here half of the noisy runs of each grid choose a setting, together with the "
    "clean ones, and ground truth judges the choice on the other half, by the median true error against nominal's, "
    f"averaged over all ways to halve them. Beside the pick of the score (`{AGGREGATE}`) stand the settings that "
    "someone with ground truth would choose from the same runs: from the clean ones or from the seen noisy ones. "
    '"In hindsight" is the best setting of the unseen half itself, which nobody can know. The last columns are rank '
    "correlations, of the score and of the true error of clean runs with the true error on unseen images. The first "
    f"row averages shares over grids where hindsight gains more than {WORTH_FINDING:.0%}, a loss as -100 % at the most."
)
JOINT = (
    f"One search over the five options of table 2 by the sampler that is named, {joint.CLEAN} clean and {joint.NOISY} "
    "noisy runs a trial, beside the five sweeps of one option. Someone who does not know which option matters pays for "
    "all five sweeps."
)
SEVERAL = (
    f"One search over `{several.OPTION.name}` for {', '.join(several.SEARCHED)} together; {several.HELD_OUT} is held "
    "out: it is run at confirmation only, and can prevent an adoption. Each candidate of the confirmation over the "
    f"searched sequences together and on each one, with {several.CONFIRMATION} fresh noisy runs; the true ATE is that "
    "of the sequence's own grid."
)
K_DELTA = (
    "R2 between score and true ATE for numbers of noisy runs, averaged over random choices among those there are "
    "(the paper shows 1 to 60)."
)
LADDER = (
    f"Nominal setting over noise levels, {ladder.RUNS} noisy runs each; level 0 is clean against other clean runs. "
    "Where the response per grey level is constant the pipeline is linear (the paper's assumption); `gtf-tune noise` "
    "measures this on any sequence. Where the floor lies far above the scores, most clean runs fell apart and noisy "
    "ones did not; it is ignored then."
)
_IDLE = "; ".join(f"{name} ({reason})" for name, reason in WITHOUT_EFFECT.items())
_SWEPT = len(pairs()) + len(OPTIONS)
ABLATION = (
    f"Of the paper's {_SWEPT + len(WITHOUT_SUCCESSOR) + len(WITHOUT_EFFECT)} options {len(WITHOUT_SUCCESSOR)} have no "
    f"successor in COLMAP 4 ({'; '.join(WITHOUT_SUCCESSOR)}), and {len(WITHOUT_EFFECT)} do nothing on these sequences: "
    f"{_IDLE}. The other {_SWEPT} are swept, each at a stricter and a laxer value (the five of table 2 over their "
    "grids); ranges of the true ATE and of the score against nominal."
)
TRAPS = (
    "An option that can register fewer frames at its strict end, where the error over the frames that are left may be "
    "small. A setting below the coverage floor is infeasible: neither search nor pick can fall for it."
)
FRAGILE = (
    "Settings that ran into the coverage floor, or whose noisy runs collapsed, with their true ATE against nominal."
)
