"""A run in other formats: CSV, VTP, files for ParaView."""
