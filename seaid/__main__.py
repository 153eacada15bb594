"""`python -m seaid`: the command line."""

from seaid.cli import main

if __name__ == "__main__":
    main()
