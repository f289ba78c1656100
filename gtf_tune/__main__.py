"""Run the command line as ``python -m gtf_tune``."""

from gtf_tune.cli.main import main

if __name__ == "__main__":
    main()
