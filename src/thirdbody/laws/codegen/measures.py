"""Composition of measures into one generated, compiled function that is called for each contact of a step."""

from collections.abc import Callable, Sequence

from thirdbody.laws.codegen.fragments import HEAD, field_names, imports_of, tuples_for
from thirdbody.laws.codegen.module_cache import load_module
from thirdbody.laws.measures import MEAN, Measure, has_means, largest, summed


def measures_text(measures: Sequence[Measure]) -> str:
    """Return the text of the module: each kernel is called once; its amounts go to the columns behind the contact radius."""
    imports: list[str] = []
    lines: list[str] = []
    counts = [len(field_names(measure.parameters)) for measure in measures]
    for k, measure in enumerate(measures):
        imports += imports_of(k, measure.kernel, measure.parameters)
        values = ", ".join(f"parameters[row * {sum(counts)} + {sum(counts[:k]) + i}]" for i in range(counts[k]))
        lines.append(f"    r{k} = kernel_{k}(s, parameters_{k}({values}))")
    column = 1
    lines.append("    H[k, at] = s.contact_radius if s.contact_radius > 0.0 else H[k, at]")
    for k, i in summed(measures):
        value = f"s.dt * r{k}[{i}]" if measures[k].amounts[i].kind == MEAN else f"r{k}[{i}]"
        lines.append(f"    H[k, at + {column}] += {value}")
        column += 1
    if has_means(measures):
        lines.append(f"    H[k, at + {column}] += s.dt")
        column += 1
    for k, i in largest(measures):
        lines.append(f"    H[k, at + {column}] = max(H[k, at + {column}], r{k}[{i}])")
        column += 1
    imports.append("from thirdbody.kernels.signatures import MEASURE")
    head = HEAD.format(title=" + ".join(measure.name for measure in measures), tuples=tuples_for(()), imports="\n".join(imports))
    return head + "@njit(MEASURE, **OPTIONS)\ndef measure(s, row, H, k, at, parameters):\n" + "\n".join(lines) + "\n"


def compose_measures(measures: Sequence[Measure]) -> Callable:
    """Compile the function of signature `MEASURE` that evaluates these measures."""
    return load_module("measure", measures_text(measures), [measure.kernel for measure in measures])[0].measure
