"""``python -m kfit``: the same as the console script."""

from kfit.cli.main import main

main()
