"""Measure gtf-tune; ``python -m benchmarks`` runs everything and writes docs/performance.md."""
