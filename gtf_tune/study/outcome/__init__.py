"""What a study found: confirmation, verdict, recommendation, export."""
