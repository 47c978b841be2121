"""Kernels as plain Python: a few steps cost less than to compile them. A run compiles the same source in its chains."""

import math
from types import CellType, FunctionType, ModuleType, SimpleNamespace

import numpy as np
from numba.extending import _Intrinsic


def store(table, i, c, v):
    table[i, c : c + 4] = v


FOURS = {
    "load": lambda table, i, c: table[i, c : c + 4].copy(),
    "store": store,
    "set4": lambda *v: np.array(v),
    "broadcast": lambda x: np.full(4, x),
    "extract": lambda v, k: float(v[k]),
    "broadcast_lane": lambda v, k: np.full(4, v[k]),
    "with_last": lambda v, w: np.append(v[:3], w[3]),
    "cross": lambda v, w: np.append(np.cross(v[:3], w[:3]), 0.0),
    "round_to_nearest": np.rint,
    "less_mask": lambda v, w: int((v < w) @ (1, 2, 4, 8)),
    "prefetch": lambda table, i, c: None,
    "get": lambda G, at: G[at : at + 4].copy(),
    "put": lambda G, at, v: G.__setitem__(slice(at, at + 4), v),
    "transpose": lambda *rows: tuple(np.array(rows).T),
    "all_below": lambda v, maximum: bool((v < maximum).all()),
}  # of `jit.simd`
MATH = SimpleNamespace(**vars(math) | {"sqrt": np.sqrt})  # in kernels a division by a root of nothing is infinite


class PlainModule:
    def __init__(self, module, made):
        self.module, self.made = module, made

    def __getattr__(self, name):
        return of_value(getattr(self.module, name), self.made)


def of_value(value, made):
    if value is math:
        return MATH
    if isinstance(value, ModuleType) and value.__name__.startswith("thirdbody"):
        return PlainModule(value, made)
    if isinstance(value, _Intrinsic):  # others turn an address into a function; here the function itself stands for its address
        return FOURS.get(value._name, lambda function: function)
    return plain(value, made) if hasattr(value, "py_func") else value


def plain(kernel, made=None):
    """The function behind a kernel, and those behind all that it calls."""
    made, function = {} if made is None else made, kernel.py_func
    if function not in made:
        names = dict(function.__globals__)
        cells = tuple(CellType(of_value(cell.cell_contents, made)) for cell in function.__closure__ or ())
        made[function] = FunctionType(function.__code__, names, None, function.__defaults__, cells)
        names.update({name: of_value(names[name], made) for name in function.__code__.co_names if name in names})
    return made[function]
