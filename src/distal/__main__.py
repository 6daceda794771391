"""`python -m distal`: the command line."""

from distal.cli import main

if __name__ == "__main__":
    main()
