"""``python -m cartier`` is the command ``cartier``."""

from cartier.cli import main

main()
