"""``python -m stonecut`` is the command line."""

from ._cli import main

main()
