"""The columns of all tables of numbers, each declared once: name, width, unit, meaning.

A module stands for a table, and its upper-case names for the first columns of its quantities: kernels write
`B[b, body.FORCE + d]`, Python around them `B[:, body.FORCE3]`, all three columns as a slice. `WIDTH` is the number of
columns. `print(body.table.markdown())` describes a table.

Tables are C-contiguous float64 with one row per thing, so that a kernel touches one cache line where it can.
"""
