"""A run in other formats: CSV, VTP, compressed copies, files for ParaView."""
