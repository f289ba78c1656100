import csv
import io

from gtf_tune.study.outcome.export import table_csv


def test_a_cell_that_a_spreadsheet_would_compute_is_a_text_in_csv_and_numbers_stay_numbers() -> None:
    rows = [['=HYPERLINK("x")', "+1+1", "@cmd", "-x", -0.5, "-1.5e-3", "-", None, "cmd = 1"]]

    written = list(csv.reader(io.StringIO(table_csv(["a"] * 9, rows))))[1]

    assert written == ['\'=HYPERLINK("x")', "'+1+1", "'@cmd", "'-x", "-0.5", "-1.5e-3", "-", "", "cmd = 1"]
