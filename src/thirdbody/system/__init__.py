"""Processes, signals, streams, address space and cores: calls of Python and of the operating system."""
