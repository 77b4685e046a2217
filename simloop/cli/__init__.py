"""The command line: ``simloop`` and ``python -m simloop.cli``. It starts in ``cli.main.main``."""
