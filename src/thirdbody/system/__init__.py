"""Processes, signals, streams, address space and cores: calls to Python and to the operating system."""
