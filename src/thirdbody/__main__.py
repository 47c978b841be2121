"""`python -m thirdbody`, the same as the command `thirdbody`."""

from .cli import main

main()
