"""What ``import gtf_tune`` offers to scripts and notebooks; everything is imported when it is first used."""
