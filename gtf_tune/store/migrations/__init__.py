"""One migration per revision of gtf-tune's tables."""
