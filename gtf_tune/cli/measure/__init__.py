"""Commands that measure configurations on one sequence, without a study."""
