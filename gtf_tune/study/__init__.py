"""Create, run, resume and read studies."""
