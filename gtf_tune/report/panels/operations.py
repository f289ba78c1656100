"""Show how the work went: failures, time and memory, timeline, and what it takes to repeat it."""

from gtf_tune.display import count, duration, memory, share
from gtf_tune.report import markup
from gtf_tune.report.figures.costs import stage_figure, timeline_figure
from gtf_tune.report.markup import Html
from gtf_tune.report.panels.blocks import Block, Drawing, ReportInput
from gtf_tune.report.tables.costs import StudyCost, run_costs, runs_made, stage_costs, study_cost
from gtf_tune.report.tables.failures import RunFailure, run_failures, trial_faults
from gtf_tune.report.tables.provenance import provenance
from gtf_tune.report.tables.timeline import timeline

_LISTED_TRIALS = 12


def failures_panel(report: ReportInput) -> list[Block]:
    """Return the reasons of failed runs with an excerpt of a log each, and why trials have no value."""
    failures, faults = run_failures(report.data), trial_faults(report.data)
    if not failures and not faults:
        return [markup.missing("Nothing failed: every run ended with a trajectory, and every trial is feasible.")]
    blocks: list[Block] = [_failure(one, report) for one in failures]
    if not failures:
        blocks.append(markup.missing("No run failed."))
    if faults:
        rows = [(one.what, one.reason, one.count, _trial_list(one.ordinals)) for one in faults]
        blocks.append(markup.table(["what", "reason", ">count", "trials"], rows))
    return blocks


def costs_panel(report: ReportInput) -> list[Block]:
    """Return time by stage with cache hits, time and memory by run, and how many runs were not done twice."""
    made = runs_made(report.data.runs)
    if not made:
        return [markup.missing("No run was made for this study, so it cost no time.")]
    cost = study_cost(report.data)
    blocks: list[Block] = [
        markup.paragraph(
            f"The trials needed {count(cost.uses, 'run')}; {cost.made} were executed and {cost.reused} found in the "
            f"database. All runs together took {duration(cost.compute_s)}; from its first to its last trial the study "
            f"took {duration(cost.elapsed_s)}, on {count(len(cost.machines), 'machine')}.{_confirmation_text(cost)}"
        )
    ]
    stages = stage_costs([one.run for one in made])
    if stages:
        blocks.append(Drawing("stages", "", stage_figure(stages), is_wide=True))
        rows = [
            (one.stage, duration(one.total_s), share(one.share), duration(one.mean_s), one.computed, one.cached)
            for one in stages
        ]
        blocks.append(markup.table(["stage", ">total", ">share", ">mean", ">computed", ">from the cache"], rows))
    else:
        blocks.append(markup.missing("The pipeline reports no stages, so only whole runs are listed."))
    blocks.append(_run_table(report))
    return blocks


def timeline_panel(report: ReportInput) -> list[Block]:
    """Return the runs over time by machine."""
    bars = timeline(runs_made(report.data.runs))
    if not bars:
        return [markup.missing("No run has a start time, so there is no timeline.")]
    return [Drawing("timeline", "", timeline_figure(bars), is_wide=True)]


def reproducibility_panel(report: ReportInput) -> list[Block]:
    """Return versions, seeds, fingerprints and the whole definition."""
    found = provenance(report.data)
    facts = [*found.versions, ("sampler", found.sampler), ("seed of the study", str(found.seed))]
    facts.append(("threads of a run", ", ".join(str(one) for one in found.threads) or "-"))
    facts.append(("storage", report.data.storage))
    sequences = [
        (
            one.name,
            one.role,
            one.path,
            one.layout,
            one.frames,
            one.size,
            one.camera,
            one.sigma,
            "yes" if one.has_ground_truth else "no",
            markup.cell(markup.code(one.fingerprint)),
        )
        for one in found.sequences
    ]
    columns = [
        "sequence",
        "role",
        "path",
        "layout",
        ">frames",
        ">size [px]",
        "camera",
        ">noise [grey levels]",
        "ground truth",
    ]
    return [
        markup.table(["what", "value"], facts),
        markup.table([*columns, "fingerprint"], sequences),
        markup.folded("Definition of the study", markup.snippet("definition (JSON)", found.definition)),
    ]


def _failure(failure: RunFailure, report: ReportInput) -> Html:
    log = report.logs.get(failure.example_key, "")
    excerpt = "\n".join(log.rstrip().splitlines()[-report.definition.log_lines :])
    title = f"{count(failure.runs, 'run')}: {failure.reason}"
    where = markup.paragraph(
        f"On {', '.join(failure.sequences)}, {'trial' if len(failure.ordinals) == 1 else 'trials'} "
        f"{_trial_list(failure.ordinals)}; the end of the log of {failure.example}:"
    )
    shown = markup.element("pre", markup.text(excerpt)) if excerpt else markup.missing("The run printed nothing.")
    return markup.element("details", markup.element("summary", markup.text(title)), where, shown, open="")


def _confirmation_text(cost: StudyCost) -> str:
    if not cost.confirmation_runs:
        return ""
    runs = count(cost.confirmation_runs, "more run")
    return f" Confirmations with fresh seeds took {runs} and {duration(cost.confirmation_s)}."


def _run_table(report: ReportInput) -> Html:
    rows = [
        (
            one.sequence,
            one.kind,
            one.runs,
            duration(one.median_s),
            duration(one.longest_s),
            memory(one.median_bytes),
            memory(one.largest_bytes),
        )
        for one in run_costs(runs_made(report.data.runs))
    ]
    columns = ["sequence", "kind", ">runs", ">median time", ">longest", ">median peak memory", ">largest"]
    return markup.table(columns, rows)


def _trial_list(ordinals: tuple[int, ...]) -> str:
    shown = ", ".join(str(one) for one in ordinals[:_LISTED_TRIALS])
    return shown + (f" and {len(ordinals) - _LISTED_TRIALS} more" if len(ordinals) > _LISTED_TRIALS else "")
