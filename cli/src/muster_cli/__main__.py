"""`python -m muster_cli` is the `muster` command."""

from .main import main

main()
