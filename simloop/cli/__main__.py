"""Lets ``python -m simloop.cli`` do what the command ``simloop`` does."""

from simloop.cli.main import main

if __name__ == "__main__":
    main()
