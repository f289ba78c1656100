"""Work on a study: trials, workers, the server, what they announce."""
