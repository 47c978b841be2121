"""What Python and the operating system are asked for: processes, signals, streams, address space, cores."""
