"""All that knows the tables and the private names of Optuna."""
