"""Draw the tables with Plotly; every number comes from `gtf_tune.report.tables`."""
