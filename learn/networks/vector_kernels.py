"""Vector kernels of the context-delay layer for one CPU thread, float32, without a C compiler.

numba compiles the loops; the innermost tiles are written as LLVM vector operations, because no
automatic vectoriser keeps a block of accumulators in registers. Every array holds `LANES` sequences
side by side as its last axis, so that one lane never meets another until gradients are summed.

A step of the layer multiplies (hidden, 5 hidden) by (5 hidden, LANES). In the layout
(time, features, LANES) the past five states are one contiguous block that lies in the first-level
cache, and the weights stream past it once per time step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from twin.compiled import jit

Floats = NDArray[np.float32]

LANES = 16
"""Sequences side by side: two AVX2 registers, one AVX-512 register, four NEON registers."""

WIDTH = 16 if binding.get_host_cpu_features().get("avx512f") else 8
"""Floats per vector operation."""

ROWS = 10 if WIDTH == LANES else 5
"""Output rows per register tile. ROWS * LANES / WIDTH = 10 accumulators hide the latency of a
fused multiply-add on two ports and leave registers for the operands."""

SUM_ROWS, SUM_COLUMNS = 5, 2
"""Register tile of the weight gradients: ten accumulators again."""

SUM_TIMES = 32
"""Time steps summed in registers before a gradient tile goes back to memory; the operands of one
tile, (SUM_ROWS + SUM_COLUMNS) * SUM_TIMES * LANES floats, stay in a 32 KiB first-level cache."""

_FLOAT = ir.FloatType()
_INT = ir.IntType(64)
_INT32 = ir.IntType(32)
_VECTOR = ir.VectorType(_FLOAT, WIDTH)
_INT_VECTOR = ir.VectorType(_INT32, WIDTH)
_SCALAR_BYTES = 4
_PARTS = LANES // WIDTH


def _pointer(
    builder: ir.IRBuilder, address: ir.Value, floats: ir.Value | int, kind: ir.Type
) -> Any:
    offset = floats if isinstance(floats, ir.Value) else ir.Constant(_INT, floats)
    moved = builder.add(address, builder.mul(offset, ir.Constant(_INT, _SCALAR_BYTES)))
    return builder.inttoptr(moved, kind.as_pointer())


def _load(builder: ir.IRBuilder, address: ir.Value, floats: ir.Value | int) -> ir.Value:
    value = builder.load(_pointer(builder, address, floats, _VECTOR))
    value.align = _SCALAR_BYTES
    return value


def _store(
    builder: ir.IRBuilder, value: ir.Value, address: ir.Value, floats: ir.Value | int
) -> None:
    builder.store(value, _pointer(builder, address, floats, _VECTOR)).align = _SCALAR_BYTES


def _splat(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    undefined = ir.Constant(ir.VectorType(value.type, WIDTH), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_INT32, 0))
    return builder.shuffle_vector(
        first, undefined, ir.Constant(ir.VectorType(_INT32, WIDTH), [0] * WIDTH)
    )


def _broadcast(builder: ir.IRBuilder, address: ir.Value, floats: ir.Value | int) -> ir.Value:
    value = builder.load(_pointer(builder, address, floats, _FLOAT))
    value.align = _SCALAR_BYTES
    return _splat(builder, value)


def _constant(value: float) -> ir.Value:
    return ir.Constant(_VECTOR, [float(np.float32(value))] * WIDTH)


def _call(builder: ir.IRBuilder, name: str, *arguments: ir.Value) -> ir.Value:
    """An LLVM intrinsic on whole vectors, e.g. `fma`, `minnum`, `rint`."""
    kind = ir.FunctionType(_VECTOR, [_VECTOR] * len(arguments))
    full_name = f"llvm.{name}.v{WIDTH}f32"
    function = cgutils.get_or_insert_function(builder.module, kind, full_name)
    return builder.call(function, arguments)


def _fma(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, c: ir.Value) -> ir.Value:
    return _call(builder, "fma", a, b, c)


def _tanh(builder: ir.IRBuilder, x: ir.Value) -> ir.Value:
    """tanh(x) = 1 - 2 / (exp(2 x) + 1); exp by powers of two and its Taylor series to degree 7.

    Absolute error below 2e-7: on |r| <= ln(2)/2 the remainder r^8/8! is 5e-9, and float32 rounding
    does the rest. |x| is limited to 9, where 1 - tanh is 3e-8, half a unit in the last place.
    """
    limit = _constant(9.0)
    low = _constant(-9.0)
    nan = builder.fcmp_unordered("uno", x, x)
    clipped = _call(builder, "maxnum", _call(builder, "minnum", x, limit), low)
    power = _call(builder, "rint", builder.fmul(clipped, _constant(2.0 / np.log(2.0))))
    # ln 2 in two parts, the first exact in 12 bits, so that the remainder keeps its digits.
    ln2_high = 0.693359375
    ln2_low = np.log(2.0) - ln2_high
    twice = builder.fadd(clipped, clipped)
    rest = _fma(builder, power, _constant(-ln2_high), twice)
    rest = _fma(builder, power, _constant(-ln2_low), rest)
    series = _constant(1.0 / 5040.0)
    for factorial in (720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0):
        series = _fma(builder, series, rest, _constant(1.0 / factorial))
    exponent = builder.shl(
        builder.add(builder.fptosi(power, _INT_VECTOR), ir.Constant(_INT_VECTOR, [127] * WIDTH)),
        ir.Constant(_INT_VECTOR, [23] * WIDTH),
    )
    exp = builder.fmul(series, builder.bitcast(exponent, _VECTOR))
    one = _constant(1.0)
    value = builder.fsub(one, builder.fdiv(_constant(2.0), builder.fadd(exp, one)))
    return builder.select(nan, x, value)


def _loop(
    builder: ir.IRBuilder,
    count: ir.Value,
    start: list[ir.Value],
    body: Callable[[ir.Value, list[ir.Value]], list[ir.Value]],
) -> list[ir.Value]:
    """`for k in range(count): values = body(k, values)` with the values in registers."""
    before = builder.block
    head = builder.append_basic_block("head")
    inside = builder.append_basic_block("inside")
    after = builder.append_basic_block("after")
    builder.branch(head)
    builder.position_at_end(head)
    k = builder.phi(_INT)
    k.add_incoming(ir.Constant(_INT, 0), before)
    values = []
    for value in start:
        phi = builder.phi(value.type)
        phi.add_incoming(value, before)
        values.append(phi)
    builder.cbranch(builder.icmp_signed("<", k, count), inside, after)
    builder.position_at_end(inside)
    new = body(k, values)
    end = builder.block
    k.add_incoming(builder.add(k, ir.Constant(_INT, 1)), end)
    for phi, value in zip(values, new, strict=True):
        phi.add_incoming(value, end)
    builder.branch(head)
    builder.position_at_end(after)
    return values


def _multiply(
    builder: ir.IRBuilder,
    values: list[ir.Value],
    weights: ir.Value,
    operand: ir.Value,
    depth: ir.Value,
) -> list[ir.Value]:
    """values[row, part] += weights[k, row] * operand[k, part] summed over k < depth.

    `weights` is the address of (depth, ROWS) floats, `operand` of (depth, LANES) floats.
    """

    def body(k: ir.Value, sums: list[ir.Value]) -> list[ir.Value]:
        row = builder.mul(k, ir.Constant(_INT, LANES))
        packed = builder.mul(k, ir.Constant(_INT, ROWS))
        columns = [
            _load(builder, operand, builder.add(row, ir.Constant(_INT, part * WIDTH)))
            for part in range(_PARTS)
        ]
        new = []
        for r in range(ROWS):
            factor = _broadcast(builder, weights, builder.add(packed, ir.Constant(_INT, r)))
            for part in range(_PARTS):
                new.append(_fma(builder, factor, columns[part], sums[r * _PARTS + part]))
        return new

    return _loop(builder, depth, values, body)


def _tiles() -> list[tuple[int, int]]:
    return [(r, part) for r in range(ROWS) for part in range(_PARTS)]


@intrinsic
def _forward_tile(typing_context, bias, weights, operand, depth, recurrent, past, past_depth, out):
    """out = tanh(bias + weights operand + recurrent past) on ROWS rows; all addresses."""

    def generate(context, builder, signature, args):
        bias, weights, operand, depth, recurrent, past, past_depth, out = args
        values = [_broadcast(builder, bias, r) for r, _ in _tiles()]
        values = _multiply(builder, values, weights, operand, depth)
        values = _multiply(builder, values, recurrent, past, past_depth)
        for (r, part), value in zip(_tiles(), values, strict=True):
            _store(builder, _tanh(builder, value), out, r * LANES + part * WIDTH)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 8), generate


@intrinsic
def _backward_tile(typing_context, gradient, recurrent, future, future_depth, state, out):
    """out = (1 - state^2) (gradient + recurrent future) on ROWS rows."""

    def generate(context, builder, signature, args):
        gradient, recurrent, future, future_depth, state, out = args
        offsets = [r * LANES + part * WIDTH for r, part in _tiles()]
        values = [_load(builder, gradient, offset) for offset in offsets]
        values = _multiply(builder, values, recurrent, future, future_depth)
        for offset, value in zip(offsets, values, strict=True):
            h = _load(builder, state, offset)
            slope = _fma(builder, builder.fneg(h), h, _constant(1.0))
            _store(builder, builder.fmul(slope, value), out, offset)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 6), generate


@intrinsic
def _product_tile(typing_context, weights, operand, depth, out):
    """out = weights operand on ROWS rows."""

    def generate(context, builder, signature, args):
        weights, operand, depth, out = args
        values = [_constant(0.0) for _ in _tiles()]
        values = _multiply(builder, values, weights, operand, depth)
        for (r, part), value in zip(_tiles(), values, strict=True):
            _store(builder, value, out, r * LANES + part * WIDTH)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 4), generate


@intrinsic
def _sum_tile(typing_context, left, left_step, right, right_step, count, out, out_step):
    """out[r, c] += sum over `count` times of left[t, r] * right[t, c], lane by lane.

    `left_step` and `right_step` are floats from one time to the next, `out_step` floats from one
    row of `out` (rows, columns, WIDTH) to the next.
    """

    def generate(context, builder, signature, args):
        left, left_step, right, right_step, count, out, out_step = args
        places = [
            builder.add(builder.mul(out_step, ir.Constant(_INT, r)), ir.Constant(_INT, c * WIDTH))
            for r in range(SUM_ROWS)
            for c in range(SUM_COLUMNS)
        ]
        start = [_load(builder, out, place) for place in places]

        def body(t, sums):
            left_row = builder.mul(t, left_step)
            right_row = builder.mul(t, right_step)
            for part in range(_PARTS):
                columns = [
                    _load(
                        builder,
                        right,
                        builder.add(right_row, ir.Constant(_INT, c * LANES + part * WIDTH)),
                    )
                    for c in range(SUM_COLUMNS)
                ]
                new = []
                for r in range(SUM_ROWS):
                    row = _load(
                        builder,
                        left,
                        builder.add(left_row, ir.Constant(_INT, r * LANES + part * WIDTH)),
                    )
                    for c in range(SUM_COLUMNS):
                        new.append(_fma(builder, row, columns[c], sums[r * SUM_COLUMNS + c]))
                sums = new
            return sums

        for place, value in zip(places, _loop(builder, count, start, body), strict=True):
            _store(builder, value, out, place)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 7), generate


@intrinsic
def _copy_runs(typing_context, source, source_step, count, vectors, out):
    """Copy `count` runs of `vectors` vectors, `source_step` floats apart, to one run at `out`."""

    def generate(context, builder, signature, args):
        source, source_step, count, vectors, out = args
        width = ir.Constant(_INT, WIDTH)

        def run(t, _):
            source_row = builder.mul(t, source_step)
            out_row = builder.mul(t, builder.mul(vectors, width))

            def vector(k, _):
                shift = builder.mul(k, width)
                value = _load(builder, source, builder.add(source_row, shift))
                _store(builder, value, out, builder.add(out_row, shift))
                return []

            return _loop(builder, vectors, [], vector)

        _loop(builder, count, [], run)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), generate


@intrinsic
def _add_rows(typing_context, source, source_step, count, out):
    """out[r] += sum of source[t, r] over `count` times on SUM_ROWS rows of LANES floats."""

    def generate(context, builder, signature, args):
        source, source_step, count, out = args
        offsets = [k * WIDTH for k in range(SUM_ROWS * _PARTS)]

        def body(t, sums):
            row = builder.mul(t, source_step)
            return [
                builder.fadd(total, _load(builder, source, builder.add(row, ir.Constant(_INT, k))))
                for total, k in zip(sums, offsets, strict=True)
            ]

        start = [_load(builder, out, k) for k in offsets]
        for k, value in zip(offsets, _loop(builder, count, start, body), strict=True):
            _store(builder, value, out, k)
        return context.get_dummy_value()

    return types.void(*[types.intp] * 4), generate


_compiled = jit(nogil=True)
"""Kernels take addresses and sizes: one compilation serves tensors of any stride between tiles,
and no array slice is made inside a loop."""


@_compiled
def forward(
    tiles, times, inputs, hidden, past, x, x_tile, states, states_tile, bias, weights, recurrent
):
    """Fill states[:, past:] from x and the `past` states in front.

    Args:
      tiles, times, inputs, hidden, past: sizes; hidden a multiple of ROWS.
      x: address of (tiles, times, inputs, LANES); `x_tile` floats from one tile to the next.
      states: address of (tiles, past + times, hidden, LANES); `states_tile` likewise.
      bias: address of (hidden,).
      weights: address of (hidden / ROWS, inputs, ROWS), see `pack`.
      recurrent: address of (hidden / ROWS, past * hidden, ROWS), oldest state first.
    """
    block_bytes = _SCALAR_BYTES * ROWS * LANES
    for tile in range(tiles):
        now = x + _SCALAR_BYTES * tile * x_tile
        before = states + _SCALAR_BYTES * tile * states_tile
        out = before + _SCALAR_BYTES * past * hidden * LANES
        for _ in range(times):
            for block in range(hidden // ROWS):
                _forward_tile(
                    bias + _SCALAR_BYTES * block * ROWS,
                    weights + _SCALAR_BYTES * block * ROWS * inputs,
                    now,
                    inputs,
                    recurrent + _SCALAR_BYTES * block * ROWS * past * hidden,
                    before,
                    past * hidden,
                    out + block * block_bytes,
                )
            now += _SCALAR_BYTES * inputs * LANES
            before += _SCALAR_BYTES * hidden * LANES
            out += _SCALAR_BYTES * hidden * LANES


@_compiled
def backward(
    tiles, times, hidden, past, gradient, gradient_tile, states, states_tile, deltas, recurrent
):
    """Fill deltas[:, :times], the gradients before tanh, from those after it.

    Args:
      gradient: address of (tiles, times, hidden, LANES).
      states: address of the state of time 0, (tiles, times, hidden, LANES).
      deltas: address of (tiles, times + past, hidden, LANES), zero in the last `past` rows.
      recurrent: address of (hidden / ROWS, past * hidden, ROWS), transposed, next time first.
    """
    row_bytes = _SCALAR_BYTES * hidden * LANES
    for tile in range(tiles):
        above = gradient + _SCALAR_BYTES * tile * gradient_tile
        state = states + _SCALAR_BYTES * tile * states_tile
        delta = deltas + row_bytes * tile * (times + past)
        for t in range(times - 1, -1, -1):
            for block in range(hidden // ROWS):
                shift = _SCALAR_BYTES * block * ROWS * LANES
                _backward_tile(
                    above + t * row_bytes + shift,
                    recurrent + _SCALAR_BYTES * block * ROWS * past * hidden,
                    delta + (t + 1) * row_bytes,
                    past * hidden,
                    state + t * row_bytes + shift,
                    delta + t * row_bytes + shift,
                )


@_compiled
def products(tiles, times, depth, rows, weights, operand, operand_tile, out):
    """out[:, t] = weights operand[:, t] for every time below `times`.

    Args:
      weights: address of (rows / ROWS, depth, ROWS).
      operand: address of (tiles, >= times, depth, LANES).
      out: address of (tiles, times, rows, LANES).
    """
    for tile in range(tiles):
        source = operand + _SCALAR_BYTES * tile * operand_tile
        for _ in range(times):
            for block in range(rows // ROWS):
                _product_tile(
                    weights + _SCALAR_BYTES * block * ROWS * depth,
                    source,
                    depth,
                    out + _SCALAR_BYTES * block * ROWS * LANES,
                )
            source += _SCALAR_BYTES * depth * LANES
            out += _SCALAR_BYTES * rows * LANES


@_compiled
def outer_sums(
    tiles, times, delays, rows, columns, left, left_tile, right, right_tile, scratch, out
):
    """out[r, d, c] += sum over tiles and times of left[:, t, r] * right[:, t + d, c].

    Args:
      rows: of `left`, a multiple of SUM_ROWS.
      columns: of `right`, a multiple of SUM_COLUMNS.
      left: address of (tiles, >= times, rows, LANES).
      right: address of (tiles, >= times + delays - 1, columns, LANES).
      scratch: address of `scratch_size(...)` floats.
      out: address of (rows, delays, columns, WIDTH); the caller sums the last axis.
    """
    reach = SUM_TIMES + delays - 1
    left_step, right_step, out_step = (
        SUM_ROWS * LANES,
        SUM_COLUMNS * LANES,
        delays * columns * WIDTH,
    )
    rights = scratch + _SCALAR_BYTES * rows * SUM_TIMES * LANES
    for tile in range(tiles):
        for start in range(0, times, SUM_TIMES):
            count = min(SUM_TIMES, times - start)
            source = left + _SCALAR_BYTES * (tile * left_tile + start * rows * LANES)
            for row in range(rows // SUM_ROWS):
                _copy_runs(
                    source + _SCALAR_BYTES * row * left_step,
                    rows * LANES,
                    count,
                    left_step // WIDTH,
                    scratch + _SCALAR_BYTES * row * SUM_TIMES * left_step,
                )
            source = right + _SCALAR_BYTES * (tile * right_tile + start * columns * LANES)
            for column in range(columns // SUM_COLUMNS):
                _copy_runs(
                    source + _SCALAR_BYTES * column * right_step,
                    columns * LANES,
                    count + delays - 1,
                    right_step // WIDTH,
                    rights + _SCALAR_BYTES * column * reach * right_step,
                )
            for row in range(rows // SUM_ROWS):
                for column in range(columns // SUM_COLUMNS):
                    for delay in range(delays):
                        place = row * SUM_ROWS * out_step
                        place += (delay * columns + column * SUM_COLUMNS) * WIDTH
                        _sum_tile(
                            scratch + _SCALAR_BYTES * row * SUM_TIMES * left_step,
                            left_step,
                            rights + _SCALAR_BYTES * (column * reach + delay) * right_step,
                            right_step,
                            count,
                            out + _SCALAR_BYTES * place,
                            out_step,
                        )


@_compiled
def lane_sums(tiles, times, rows, operand, operand_tile, out):
    """out[r, :] += sum over tiles and times of operand[:, t, r, :]; `out` is (rows, LANES)."""
    for tile in range(tiles):
        source = operand + _SCALAR_BYTES * tile * operand_tile
        for row in range(0, rows, SUM_ROWS):
            _add_rows(
                source + _SCALAR_BYTES * row * LANES,
                rows * LANES,
                times,
                out + _SCALAR_BYTES * row * LANES,
            )


def scratch_size(rows: int, columns: int, delays: int) -> int:
    """Floats of working memory that `outer_sums` needs."""
    return LANES * (rows * SUM_TIMES + columns * (SUM_TIMES + delays - 1))


def pack(weights: Floats, rows: int) -> Floats:
    """(n, depth) weights as blocks (rows / ROWS, depth, ROWS), zero rows added up to `rows`."""
    padded = np.zeros((rows, weights.shape[1]), np.float32)
    padded[: weights.shape[0]] = weights
    return np.ascontiguousarray(padded.reshape(rows // ROWS, ROWS, -1).transpose(0, 2, 1))


def padded_size(size: int) -> int:
    """`size` rounded up so that every kernel's tiles fit."""
    step = int(np.lcm.reduce([ROWS, SUM_ROWS, SUM_COLUMNS]))
    return -(-size // step) * step
