"""`python -m distal`: the command line."""

from distal.cli import main

main()
