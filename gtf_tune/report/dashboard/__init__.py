"""Fill optuna-dashboard with what a study found, and serve it."""
