"""The outcome of a study: confirmation, verdict, recommendation, export."""
