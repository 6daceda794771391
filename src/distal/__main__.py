"""`python -m distal`: the command line."""

from distal_command import main

if __name__ == "__main__":
    main()
