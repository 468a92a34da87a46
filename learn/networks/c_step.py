"""C step: one step of a network in C99, made of weights and statements.

A kind's `c_step` gives the body of

    static inline float NAME(float *state, const float *x)

from normalised inputs to the normalised output. It may call what `PRELUDE` defines. Matrices lie
input by input (`transposed`), so that the inner loop runs over units and compilers make vector
instructions of it without being allowed to reorder sums.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from torch import Tensor

PER_LINE = 8
"""Numbers in a line of a table."""

PRELUDE = """\
/* out (rows) += weight (columns, rows) in (columns) */
static inline void gt_add(float *out, const float *weight, const float *in, int columns, int rows)
{
    for (int j = 0; j < columns; j++) {
        const float *w = weight + j * rows;
        const float v = in[j];
        for (int i = 0; i < rows; i++)
            out[i] += w[i] * v;
    }
}

/* out (rows) = bias (rows) + weight (columns, rows) in (columns) */
static inline void gt_dense(float *out, const float *weight, const float *bias, const float *in,
                            int columns, int rows)
{
    for (int i = 0; i < rows; i++)
        out[i] = bias[i];
    gt_add(out, weight, in, columns, rows);
}

static inline float gt_sigmoid(float v) { return 1.0f / (1.0f + expf(-v)); }

static inline void gt_silu(float *v, int count)
{
    for (int i = 0; i < count; i++)
        v[i] *= gt_sigmoid(v[i]);
}

static inline void gt_tanh(float *v, int count)
{
    for (int i = 0; i < count; i++)
        v[i] = tanhf(v[i]);
}

/* v within -most and most; nothing where v is not a number. */
static inline float gt_bounded(float v, float most)
{
    return v > most ? most : v < -most ? -most : v == v ? v : 0.0f;
}

/* A row goes in behind the oldest first; the oldest goes out. */
static inline void gt_append(float *rows, int count, int width, const float *row)
{
    memmove(rows, rows + width, (size_t)((count - 1) * width) * sizeof *rows);
    memcpy(rows + (count - 1) * width, row, (size_t)width * sizeof *rows);
}
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CStep:
    """One step in C."""

    arrays: Mapping[str, Tensor]
    """Constants of the body by name; they are flattened."""
    body: str
    """Statements, which end by returning the output."""

    def function(self, name: str) -> str:
        """The whole function."""
        tables = "\n".join(table(key, values) for key, values in self.arrays.items())
        statements = indented(f"{tables}\n{self.body.strip()}")
        return f"static inline float {name}(float *state, const float *x)\n{{\n{statements}\n}}\n"


def indented(text: str) -> str:
    """Four spaces before every line."""
    return "\n".join(f"    {line}" if line else "" for line in text.splitlines())


def transposed(matrix: Tensor) -> Tensor:
    """A weight matrix (rows, columns) as the prelude's functions read it."""
    return matrix.T.contiguous()


def table(name: str, values: Tensor, kind: str = "float") -> str:
    """An array of constants, float32 to the bit."""
    flat = [number(v) for v in values.detach().cpu().float().reshape(-1).tolist()]
    lines = [", ".join(flat[k : k + PER_LINE]) for k in range(0, len(flat), PER_LINE)]
    joined = ",\n    ".join(lines)
    return f"static const {kind} {name}[{len(flat)}] = {{\n    {joined}}};"


def number(value: float) -> str:
    """A float32 constant, exact."""
    text = f"{value:.9g}"
    return f"{text if set(text) & set('.e') else text + '.0'}f"


def perceptron(sizes: list[int], activation: str, source: str = "x") -> str:
    """Statements that run layers `weight_K`, `bias_K` of these sizes over `source` into
    `float out[...]` of the last size; the activation follows all but the last."""
    lines, last = [], len(sizes) - 2
    for k in range(last + 1):
        made = "out" if k == last else f"h{k}"
        lines.append(f"float {made}[{sizes[k + 1]}];")
        lines.append(
            f"gt_dense({made}, weight_{k}, bias_{k}, {source}, {sizes[k]}, {sizes[k + 1]});"
        )
        if k < last:
            lines.append(f"{activation}({made}, {sizes[k + 1]});")
        source = made
    return "\n".join(lines)
