"""C step: code of one step of a network in C99, made of weights and statements.

A network's `c_step` returns the body of

    static inline float NAME(float *state, const float *x)

from normalised inputs to the normalised output. The body may call the functions of `PRELUDE` here
and in `twin.navigation.c_math`. Matrices are stored input by input (`transposed`). The inner loop
then runs over units, and compilers can vectorise it without reordering sums.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from torch import Tensor, nn

from twin.navigation.c_math import table

PRELUDE = """\
/* out (rows) += weight (columns, rows) in (columns). With four columns in one pass, each sum is
 * loaded and stored once for the four. */
static inline void gt_add(float *out, const float *weight, const float *in, int columns, int rows)
{
    for (; columns >= 4; columns -= 4, weight += 4 * rows, in += 4)
        for (int i = 0; i < rows; i++)
            out[i] += weight[i] * in[0] + weight[rows + i] * in[1] + weight[2 * rows + i] * in[2]
                + weight[3 * rows + i] * in[3];
    for (; columns > 0; columns--, weight += rows, in++)
        for (int i = 0; i < rows; i++)
            out[i] += weight[i] * in[0];
}

/* out (rows) = bias (rows) + weight (columns, rows) in (columns) */
static inline void gt_dense(float *out, const float *weight, const float *bias, const float *in,
                            int columns, int rows)
{
    for (int i = 0; i < rows; i++)
        out[i] = bias[i];
    gt_add(out, weight, in, columns, rows);
}

static inline float gt_sigmoid(float v) { return 1.0f / (1.0f + gt_exp(-v)); }

static inline void gt_silu(float *v, int count)
{
    for (int i = 0; i < count; i++)
        v[i] *= gt_sigmoid(v[i]);
}

/* Near zero, Lambert's continued fraction: the formula with gt_exp would lose digits there. */
static inline float gt_tanh(float v)
{
    const float q = v * v;
    gt_bits near, far = {1.0f - 2.0f / (1.0f + gt_exp(2.0f * fabsf(v)))}, sign = {v};
    near.value = v * (945.0f + q * (105.0f + q)) / (945.0f + q * (420.0f + q * 15.0f));
    sign.bits &= ~0x7fffffff;
    far.bits |= sign.bits;
    const int small = -(q < 0.36f);
    near.bits = (near.bits & small) | (far.bits & ~small);
    return near.value;
}

static inline void gt_tanhs(float *v, int count)
{
    for (int i = 0; i < count; i++)
        v[i] = gt_tanh(v[i]);
}

/* Drops the oldest row, which is the first, and appends a new one. */
static inline void gt_append(float *rows, int count, int width, const float *row)
{
    memmove(rows, rows + width, (size_t)((count - 1) * width) * sizeof *rows);
    memcpy(rows + (count - 1) * width, row, (size_t)width * sizeof *rows);
}
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CStep:
    """Constants and statements of one step in C."""

    arrays: Mapping[str, Tensor]
    """Constant arrays of the body by name; C gets them flattened."""
    body: str
    """Statements, the last of which returns the output."""

    def function(self, name: str) -> str:
        """Text of the whole C function."""
        tables = "\n".join(
            table(key, values.detach().cpu().float().reshape(-1).tolist())
            for key, values in self.arrays.items()
        )
        statements = indented(f"{tables}\n{self.body.strip()}")
        return f"static inline float {name}(float *state, const float *x)\n{{\n{statements}\n}}\n"


def indented(text: str) -> str:
    """Indent every line by four spaces."""
    return "\n".join(f"    {line}" if line else "" for line in text.splitlines())


def transposed(matrix: Tensor) -> Tensor:
    """Transpose a weight matrix (rows, columns) for the functions of PRELUDE."""
    return matrix.T.contiguous()


def read_out(arrays: dict[str, Tensor], lines: list[str], out: nn.Linear, source: str) -> CStep:
    """Complete a step with a linear layer from the C array `source` to the output."""
    lines += [
        "float out[1];",
        f"gt_dense(out, weight_out, bias_out, {source}, {out.in_features}, 1);",
        "return out[0];",
    ]
    arrays |= {"weight_out": out.weight, "bias_out": out.bias}
    return CStep(arrays=arrays, body="\n".join(lines))


def perceptron(sizes: list[int], activation: str, source: str = "x") -> str:
    """C statements of a perceptron from `source` to `float out[...]`, with layers `weight_K` and
    `bias_K` of these sizes; the last layer has no activation."""
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
