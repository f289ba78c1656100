"""Write what was replayed as a page of the documentation."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from experiments.bank.bank import Bank
from experiments.bank.draw import Draw, Others, TooFewRunsError, block, paired_ratios
from experiments.bank.plan import CONFIGURATIONS, FIXED, SIGMAS
from experiments.bank.replay import BROKEN, CLEARLY, DRAWS, Replayed, draws, interval, nominal_truth, sound
from experiments.numbers import Table, mean, part, percent, plain, share, spearman
from gtf_tune.trajectory import FloatArray

FIXED_RULE, HINDSIGHT = "best fixed configuration", "hindsight"


_BEGIN, _END = "<!-- bank: written by python -m experiments.bank replay -->", "<!-- bank: end -->"

_ABOUT_SEQUENCES = (
    "Nominal is the median true ATE over noisy copies. Clean and noisy are what runs of nominal move under another "
    "seed and under the weaker noise. All three are per mille of the extent. The others are changes of the expected "
    "true ATE."
)
_ABOUT_CONFIGURATIONS = (
    "Change of the median true ATE against nominal, over the sound sequences that have the configuration."
)
_ABOUT_PREDICTORS = (
    "Spearman's rank correlation over configurations with the true ATE on unseen copies, mean over draws and then over "
    "sound sequences."
)


def page(bank: Bank, found: Sequence[Replayed]) -> str:
    """Return the whole page in Markdown."""
    places = sound(bank)
    head = (
        "# Rules on the bank of runs\n\nThis page is written by `python -m experiments.bank replay` from "
        "`experiments/bank/runs.npz`; nothing in it is typed by hand."
    )
    parts = [
        head,
        _contents(bank),
        part("Rules", _explanation(bank, places), _rule_table(bank, found, places)),
        part("Sequences", _ABOUT_SEQUENCES, _sequence_table(bank, found)),
        part("Configurations", _ABOUT_CONFIGURATIONS, _configuration_table(bank, places)),
        part("Predictors", _ABOUT_PREDICTORS, _predictor_table(bank, places)),
    ]
    return "\n\n".join(parts) + "\n"


def short_answer(bank: Bank) -> str:
    """Return in words which configuration helps most of the sound sequences, and where it hurts."""
    places = sound(bank)
    everyone = Others(bank, "")
    kept = {place: row for row, place in enumerate(everyone.sequences) if place in places}
    changes = np.expm1(everyone.truth[list(kept.values())])
    whole = [number for number in range(len(bank.labels)) if not np.isnan(changes[:, number]).any()]
    best = min(whole, key=lambda number: float(changes[:, number].mean()))
    values = changes[:, best]
    low, high = np.quantile(values, (0.1, 0.9))
    rendered = sum(bank.sequences[place].startswith("room-") for place in kept)
    worse = [
        f"{bank.sequences[place]} ({percent(value)})"
        for place, value in zip(kept, values, strict=True)
        if value > CLEARLY
    ]
    options = ", ".join(f"`{name} = {value:g}`" for name, value in CONFIGURATIONS[bank.labels[best]].items())
    return (
        f"For GLOMAP: {options}. On {int((values < -CLEARLY).sum())} of {len(values)} sequences it lowers the true ATE "
        f"by more than {CLEARLY:.0%}, by {percent(-values.mean()).lstrip('+')} in the mean (from {percent(low)} to "
        f"{percent(high)} on eight sequences of ten). It raises it on "
        f"{', '.join(worse) if worse else 'none of them by as much'}. {rendered} of the sequences are rendered rooms. "
        "Intrinsics are known and held fixed, and images are at most 800 pixels wide: on larger ones another value in "
        "pixels may be the best."
    )


def with_short_answer(text: str, bank: Bank) -> str:
    """Return a page with what stands between the two comments that begin with ``bank`` written anew."""
    before, _, rest = text.partition(_BEGIN)
    _, _, after = rest.partition(_END)
    return f"{before}{_BEGIN}\n{short_answer(bank)}\n{_END}{after}"


def _contents(bank: Bank) -> str:
    full = sum(block(bank, place) is not None for place in range(len(bank.sequences)))
    failed = int((bank.per_run["registered"] == 0).sum())
    held = ", ".join(f"`{name} = {value}`" for name, value in FIXED.items())
    return (
        f"The bank holds {int(bank.present.sum())} runs of GLOMAP, {failed} of them failed, of "
        f"{len(bank.labels)} configurations on {len(bank.sequences)} sequences in light forms; {full} sequences have "
        f"enough runs to be replayed. Held fixed: {held}."
    )


def _explanation(bank: Bank, places: Sequence[int]) -> str:
    groups = len({bank.groups[place] for place in places})
    portfolio = ", ".join(bank.labels[member] for member in Others(bank, "").portfolio(8, len(bank.labels)))
    return (
        f"Each rule sees some of the runs of a sequence and adopts one configuration; the true ATE of that one on "
        f"noisy copies that the rule did not see is compared with nominal's. Averages are over {DRAWS} splits of the "
        f"copies. Constants of a rule (the fixed configuration, the portfolio, the prior) are chosen on sequences of "
        f"other groups; sequences of one rig or car are one group. Statistics are over the {len(places)} sound "
        f"sequences in {groups} groups, where nominal's true error is below {BROKEN:.0%} of the extent, or over as "
        "many of them as have the runs that a rule needs. The interval is a bootstrap over groups, 90 %. The way is "
        "that from the fixed configuration (0 %) to hindsight (100 %). A plain run is a cold nominal run; prices are "
        f"processor time. Better or worse means by more than {CLEARLY:.0%}. From all sequences together the portfolio "
        f"is, in this order: {portfolio}."
    )


def _rule_table(bank: Bank, found: Sequence[Replayed], places: Sequence[int]) -> Table:
    by_name = {one.rule: one for one in found}
    columns = ["rule", "plain runs, median", "worst", "mean change", "90 % interval", "median", "worst"]
    columns += ["better / worse", "way", "sequences"]
    rows = []
    for one in found:
        known = [place for place in places if place in one.changes]
        if not known:
            continue
        values, prices = one.values(known), [one.prices[place] for place in known]
        low, high = interval(bank, one, known)
        fixed, best = (float(by_name[name].values(known).mean()) for name in (FIXED_RULE, HINDSIGHT))
        way = (fixed - float(values.mean())) / (fixed - best) if fixed > best else np.nan
        rows.append(
            [
                one.rule,
                f"{np.median(prices):.1f}",
                f"{max(prices):.1f}",
                percent(values.mean()),
                f"{percent(low)} to {percent(high)}",
                percent(np.median(values)),
                percent(values.max()),
                f"{one.better(known)} / {one.worse(known)}",
                share(way),
                str(len(known)),
            ]
        )
    return columns, rows


def _sequence_table(bank: Bank, found: Sequence[Replayed]) -> Table:
    shown = [one for one in found if one.rule in (FIXED_RULE, HINDSIGHT, "race of 5, 1 x 1", "ground truth, 5, 1 x 1")]
    columns = ["sequence", "frames", "configurations", "clean runs", "noisy copies", "nominal", "clean", "noisy"]
    columns += [one.rule for one in shown]
    rows = []
    weak = SIGMAS[0]
    for place, name in enumerate(bank.sequences):
        runs = block(bank, place)
        if runs is None:
            continue
        pairs, levels = bank.pairs[place, 0], (runs.clean, runs.noisy[weak])
        moved = [_known_median(pairs[np.ix_(runs.clean, copies)]) for copies in levels]
        rows.append(
            [
                name if nominal_truth(bank, place) <= BROKEN else f"{name} (broken)",
                f"{bank.frames[place]:.0f}",
                *(str(count) for count in (runs.configurations, len(runs.clean), len(runs.noisy[weak]))),
                *(plain(1000 * value) for value in (nominal_truth(bank, place), *moved)),
                *(percent(one.changes.get(place, np.nan)) for one in shown),
            ]
        )
    return columns, rows


def _configuration_table(bank: Bank, places: Sequence[int]) -> Table:
    everyone = Others(bank, "")
    kept = [row for row, place in enumerate(everyone.sequences) if place in places]
    changes = np.expm1(everyone.truth[kept])
    columns = ["configuration", "mean", "median", "worst", "best", "better / worse", "sequences"]
    rows = []
    for number, label in enumerate(bank.labels):
        values = changes[~np.isnan(changes[:, number]), number]
        if not len(values) or label not in CONFIGURATIONS:
            continue
        counted = f"{int((values < -CLEARLY).sum())} / {int((values > CLEARLY).sum())}"
        spread = (values.mean(), np.median(values), values.max(), values.min())
        rows.append([label, *(percent(value) for value in spread), counted, str(len(values))])
    return columns, rows


def _predictor_table(bank: Bank, places: Sequence[int]) -> Table:
    def seen(draw: Draw, name: str) -> FloatArray:
        columns = [*draw.clean[:1], *draw.noisy[SIGMAS[0]][:1]]
        return np.asarray(np.nanmean(bank.per_run[name][draw.sequence][np.ix_(draw.everything, columns)], axis=1))

    predictors: Mapping[str, Callable[[Draw], FloatArray]] = {
        "score, 1 x 1": lambda draw: paired_ratios(draw.tables(draw.everything, (1, 1))),
        "score, 1 x 3": lambda draw: paired_ratios(draw.tables(draw.everything, (1, 3))),
        "score, 2 x 3": lambda draw: paired_ratios(draw.tables(draw.everything, (2, 3))),
        "two clean runs": lambda draw: np.log(draw.clean_pairs(draw.everything, 2)).mean(axis=1),
        "three noisy runs": lambda draw: np.log(draw.noisy_pairs(draw.everything, 3)).mean(axis=1),
        "score at sigma 2, 1 x 3": lambda draw: paired_ratios(draw.tables(draw.everything, (1, 3), SIGMAS[1])),
        "true ATE of 1 clean and 1 noisy run": lambda draw: _median(draw.true_errors(draw.everything, (1, 1))),
        "epipolar error of verified matches": lambda draw: seen(draw, "epipolar"),
        "epipolar error of matches without a track": lambda draw: seen(draw, "epipolar_unused"),
        "deviation by the covariance": lambda draw: seen(draw, "covariance"),
        "points (fewer)": lambda draw: seen(draw, "points"),
        "track length (shorter)": lambda draw: seen(draw, "track_length"),
    }
    rows = []
    for name, predict in predictors.items():
        found = []
        for place in places:
            runs = block(bank, place)
            if runs is None:
                continue
            try:
                some = draws(bank, place, runs, Others(bank, bank.groups[place]), DRAWS // 2)
                found.append(mean(spearman(predict(d).tolist(), d.unseen_truth().tolist()) for d in some))
            except TooFewRunsError:
                continue
        if found:
            rows.append([name, plain(mean(found)), str(len(found))])
    return ["predictor", "mean correlation", "sequences"], rows


def _known_median(errors: FloatArray) -> float:
    known = errors[~np.isnan(errors)]
    return float(np.median(known)) if known.size else np.nan


def _median(errors: FloatArray) -> FloatArray:
    return np.asarray(np.median(errors, axis=1))
