"""Keep studies, trials and runs in one SQLite or PostgreSQL database, beside Optuna's tables."""
