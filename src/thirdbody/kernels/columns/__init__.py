"""The columns of all tables of numbers, each declared once: name, width, unit, meaning.

A module declares one table; its upper-case names are the indices of the first columns of its quantities. Kernels write `B[b,
body.FORCE + d]`, Python code around them `B[:, body.FORCE3]`, a slice over all three columns. `WIDTH` is the number of columns.
`print(body.table.markdown())` describes a table.

Tables are C-contiguous float64 with one row per object, so that a kernel touches one cache line per row where possible.
"""
