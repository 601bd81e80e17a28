"""`python -m maxcon`."""

from maxcon.cli import main

if __name__ == "__main__":
    main()
