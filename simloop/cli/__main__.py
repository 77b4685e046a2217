"""Make ``python -m simloop.cli`` do the same as the command ``simloop``."""

from simloop.cli.main import main

if __name__ == "__main__":
    main()
