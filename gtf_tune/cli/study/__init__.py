"""The commands under `gtf-tune study`."""
