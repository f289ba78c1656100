"""Name the verdicts of a confirmation, for those who only read them."""

ADOPT = "adopt"
KEEP = "keep nominal"
