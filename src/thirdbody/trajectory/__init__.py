"""The run file: its writer, its reader and what is computed from what it holds."""
