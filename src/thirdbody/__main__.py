"""`python -m thirdbody`, the same as the command `thirdbody`."""

from thirdbody.cli.main import main

main()
