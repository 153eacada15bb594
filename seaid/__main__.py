"""`python -m seaid`: the command line."""

from seaid.cli.program import main

if __name__ == "__main__":
    main()
