"""Turn runs into the score of a trial."""
