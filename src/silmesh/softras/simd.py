"""Float32 that fill one register, as a numba type: a block of 4 x 4 pixels, or of 4 x 2.

numba's vectoriser gives up on the rasteriser's inner loop and its wheels carry no vector math
library, so the kernels in ``silmesh.softras.cpu`` say themselves what is done a block at a time.
With AVX-512 a register holds sixteen numbers, four rows. Elsewhere a block has two rows: LLVM
lowers ``<8 x float>`` to one register where there is AVX, and to two where there is not.

    lane   0  1  2  3
           4  5  6  7
           8  9 10 11      of AVX-512 alone
          12 13 14 15

Images may be kept by rows, as ``gather`` and ``scatter`` take them, or block after block:

    x = splat(first) + columns()
    d = load(pixels, k) * x - splat(r)
    store(pixels, k, where_less(d, splat(0), a, b))
"""

import operator

import numpy as np
from llvmlite import binding, ir
from numba import config, njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model


def _has_avx512() -> bool:
    """Whether numba compiles for a processor with AVX-512 (its settings may say another one)."""
    if config.CPU_FEATURES is not None:
        return "+avx512f" in config.CPU_FEATURES
    return config.CPU_NAME is None and binding.get_host_cpu_features().get("avx512f", False)


COLUMNS = 4
ROWS = 4 if _has_avx512() else 2
LANES = COLUMNS * ROWS

_F32 = ir.FloatType()
_I32 = ir.IntType(32)
_VECTOR = ir.VectorType(_F32, LANES)
_INTEGERS = ir.VectorType(_I32, LANES)


class LanesType(types.Type):
    """The numba type of a block of float32."""

    def __init__(self):
        super().__init__(name="Lanes")


lanes = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VECTOR)


def _call(builder, name, args, result=_VECTOR):
    """Call the LLVM intrinsic ``name`` on values of their own types."""
    signature = ir.FunctionType(result, [arg.type for arg in args])
    function = cgutils.get_or_insert_function(builder.module, signature, name)
    return builder.call(function, args)


def _repeat(builder, value):
    """All lanes equal to one scalar."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(one, one, ir.Constant(_INTEGERS, [0] * LANES))


def _constant(value):
    return ir.Constant(_VECTOR, [float(np.float32(value))] * LANES)


@intrinsic
def splat(typingctx, value):
    """The same number in all lanes."""

    def codegen(context, builder, signature, args):
        return _repeat(builder, context.cast(builder, args[0], value, types.float32))

    return lanes(value), codegen


def _pattern(values):
    @intrinsic
    def make(typingctx):
        def codegen(context, builder, signature, args):
            return ir.Constant(_VECTOR, [float(value) for value in values])

        return lanes(), codegen

    return make


columns = _pattern([lane % COLUMNS for lane in range(LANES)])
rows = _pattern([lane // COLUMNS for lane in range(LANES)])


def _point(context, builder, of, array, index):
    """Where a flat array's number at ``index`` lies; nothing is checked."""
    data = context.make_array(of[0])(context, builder, array).data
    return builder.gep(data, [context.cast(builder, index, of[1], types.intp)])


@intrinsic
def load(typingctx, array, index):
    """The numbers from ``index`` on of a flat float32 array, one in each lane."""

    def codegen(context, builder, signature, args):
        at = _point(context, builder, signature.args, *args)
        return builder.load(builder.bitcast(at, _VECTOR.as_pointer()), align=4)

    return lanes(array, index), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Write the lanes from ``index`` on into a flat float32 array."""

    def codegen(context, builder, signature, args):
        at = _point(context, builder, signature.args, *args[:2])
        builder.store(args[2], builder.bitcast(at, _VECTOR.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, index, value), codegen


def _row_pointers(context, builder, signature, args):
    """Where the rows of a block begin in a flat array whose rows are args[2] apart."""
    row = ir.VectorType(_F32, COLUMNS).as_pointer()
    stride = context.cast(builder, args[2], signature.args[2], types.intp)
    starts = [_point(context, builder, signature.args, *args[:2])]
    for _ in range(1, ROWS):
        starts.append(builder.gep(starts[-1], [stride]))
    return [builder.bitcast(start, row) for start in starts]


def _choose(first, count):
    return ir.Constant(ir.VectorType(_I32, count), list(range(first, first + count)))


@intrinsic
def gather(typingctx, array, index, stride):
    """The block at ``index`` of a flat float32 array whose rows are ``stride`` apart."""

    def codegen(context, builder, signature, args):
        at = _row_pointers(context, builder, signature, args)
        parts = [builder.load(row, align=4) for row in at]
        while len(parts) > 1:
            both = _choose(0, 2 * parts[0].type.count)
            pairs = zip(parts[::2], parts[1::2], strict=True)
            parts = [builder.shuffle_vector(above, below, both) for above, below in pairs]
        return parts[0]

    return lanes(array, index, stride), codegen


@intrinsic
def scatter(typingctx, array, index, stride, value):
    """Write the block at ``index`` of a flat float32 array whose rows are ``stride`` apart."""

    def codegen(context, builder, signature, args):
        for row, at in enumerate(_row_pointers(context, builder, signature, args)):
            part = builder.shuffle_vector(args[3], args[3], _choose(row * COLUMNS, COLUMNS))
            builder.store(part, at, align=4)
        return context.get_dummy_value()

    return types.void(array, index, stride, value), codegen


def _binary(instruction):
    @intrinsic
    def apply(typingctx, a, b):
        def codegen(context, builder, signature, args):
            return getattr(builder, instruction)(*args, flags=("contract",))

        return lanes(lanes, lanes), codegen

    return apply


_add, _subtract, _multiply, _divide = map(_binary, ("fadd", "fsub", "fmul", "fdiv"))


def _overload(operation, function):
    """Let ``operation`` between lanes be written with its sign."""

    @overload(operation)
    def choose(a, b):
        if isinstance(a, LanesType) and isinstance(b, LanesType):
            return lambda a, b: function(a, b)
        return None


for _operation, _function in (
    (operator.add, _add),
    (operator.sub, _subtract),
    (operator.mul, _multiply),
    (operator.truediv, _divide),
):
    _overload(_operation, _function)


@intrinsic
def plus_product(typingctx, c, a, b):
    """``c`` + ``a`` ``b``, in one instruction where there is one."""

    def codegen(context, builder, signature, args):
        c, a, b = args
        return _call(builder, f"llvm.fmuladd.v{LANES}f32", [a, b, c])

    return lanes(lanes, lanes, lanes), codegen


@intrinsic
def minus_product(typingctx, c, a, b):
    """``c`` - ``a`` ``b``, in one instruction where there is one."""

    def codegen(context, builder, signature, args):
        c, a, b = args
        return _call(builder, f"llvm.fmuladd.v{LANES}f32", [builder.fneg(a), b, c])

    return lanes(lanes, lanes, lanes), codegen


@intrinsic
def where_less(typingctx, a, b, yes, no):
    """In each lane ``yes`` where a < b, else ``no``."""

    def codegen(context, builder, signature, args):
        a, b, yes, no = args
        return builder.select(builder.fcmp_ordered("<", a, b), yes, no)

    return lanes(lanes, lanes, lanes, lanes), codegen


@intrinsic
def smaller(typingctx, a, b):
    """The smaller in each lane."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return lanes(lanes, lanes), codegen


@intrinsic
def larger(typingctx, a, b):
    """The larger in each lane."""

    def codegen(context, builder, signature, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return lanes(lanes, lanes), codegen


@intrinsic
def any_nonzero(typingctx, a):
    """Whether any lane differs from zero."""

    def codegen(context, builder, signature, args):
        differs = builder.fcmp_unordered("!=", args[0], _constant(0.0))
        bits = builder.bitcast(differs, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(lanes), codegen


@intrinsic
def totals(typingctx, a, b, c, d, e, f):
    """The sums of all lanes of each of six, always in the same order."""

    def codegen(context, builder, signature, args):
        parts, width = list(args), LANES
        while len(parts) > 1:
            pairs = zip(parts[::2], parts[1::2] + parts[-1:], strict=False)
            parts, width = [_fold(builder, *pair, width) for pair in pairs], width // 2
        while width > 1:
            parts, width = [_fold(builder, parts[0], parts[0], width)], width // 2
        sums = [builder.extract_element(parts[0], ir.Constant(_I32, i)) for i in range(len(args))]
        return context.make_tuple(builder, signature.return_type, sums)

    return types.UniTuple(types.float32, 6)(lanes, lanes, lanes, lanes, lanes, lanes), codegen


def _fold(builder, a, b, width):
    """Add the halves of each group of ``width`` lanes of a, then of b: groups of half the width."""
    groups = range(0, 2 * LANES, width)
    half = width // 2
    first, second = (
        ir.Constant(_INTEGERS, [g + at + k for g in groups for k in range(half)])
        for at in (0, half)
    )
    return builder.fadd(*(builder.shuffle_vector(a, b, which) for which in (first, second)))


@intrinsic
def _times_power_of_two(typingctx, p, n):
    """p 2^n for n in the lowest bits of ``n``: it is added to the exponent's bits of ``p``."""

    def codegen(context, builder, signature, args):
        p, n = (builder.bitcast(arg, _INTEGERS) for arg in args)
        raised = builder.shl(n, ir.Constant(_INTEGERS, [23] * LANES))
        return builder.bitcast(builder.add(p, raised), _VECTOR)

    return lanes(lanes, lanes), codegen


# 2^f on [-1/2, 1/2] by the quintic of smallest relative error there, 8e-8 (found by reweighted
# least squares).
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c) for c in (1.00000007, 0.69314697, 0.2402212, 0.05550713, 0.00967554, 0.00132765)
)

_WHOLE = np.float32(3 * 2**22)  # a number that this is added to is rounded to a whole one


@njit
def exp2(z):
    """2^z in each lane to a relative error of 2e-7, for z in [-126, 127]; anything outside."""
    shifted = z + splat(_WHOLE)
    f = z - (shifted - splat(_WHOLE))
    p = plus_product(splat(_C4), splat(_C5), f)
    p = plus_product(splat(_C3), p, f)
    p = plus_product(splat(_C2), p, f)
    p = plus_product(splat(_C1), p, f)
    p = plus_product(splat(_C0), p, f)
    return _times_power_of_two(p, shifted)
