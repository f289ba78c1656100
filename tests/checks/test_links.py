"""The check of links finds what leads nowhere, and nothing else."""

from pathlib import Path

from tests.checks.links import anchor, broken_links


def test_a_link_to_a_missing_page_or_heading_is_named(tmp_path: Path) -> None:
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    other.write_text("# Other\n\n## What it does: a `run`, once\n")
    page.write_text(
        "[good](other.md#what-it-does-a-run-once) [web](https://example.org/x) `[code](none.md)`\n"
        "[no page](none.md) [no heading](other.md#nothing) ![no picture](images/none.svg)\n"
    )

    faults = broken_links([page])

    assert [fault.rpartition(": ")[2] for fault in faults] == [
        "there is no none.md",
        "other.md has no heading #nothing",
        "there is no images/none.svg",
    ]


def test_headings_are_linked_as_mkdocs_names_them() -> None:
    assert anchor("Any program: `command`") == "any-program-command"
