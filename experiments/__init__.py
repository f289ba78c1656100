"""Repeat the paper's experiments on every sequence with ground truth, and write docs/results-appendix.md."""
