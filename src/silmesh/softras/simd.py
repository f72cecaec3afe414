"""Eight float32 in one register, as a numba type: a block of 4 x 2 pixels.

numba's vectoriser gives up on the rasteriser's inner loop and its wheels carry no vector math
library, so the kernels in ``silmesh.softras.cpu`` say themselves what is done eight pixels at a
time. LLVM lowers ``<8 x float>`` to one register where there is AVX, and to two elsewhere.

    lane  0 1 2 3      of the pixels that begin at index k
          4 5 6 7      of those in the row below, at k + stride

    x = splat(first) + columns()
    d = load(pixels, k, stride) * x - splat(r)
    store(pixels, k, stride, where_less(d, splat(0), a, b))
"""

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

LANES = 8
COLUMNS = 4
ROWS = 2

_F32 = ir.FloatType()
_I32 = ir.IntType(32)
_VECTOR = ir.VectorType(_F32, LANES)
_INTEGERS = ir.VectorType(_I32, LANES)


class LanesType(types.Type):
    """The numba type of eight float32."""

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
    """All eight lanes equal to one scalar."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(one, one, ir.Constant(_INTEGERS, [0] * LANES))


def _constant(value):
    return ir.Constant(_VECTOR, [float(np.float32(value))] * LANES)


@intrinsic
def splat(typingctx, value):
    """Eight times the same number."""

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


columns = _pattern([0, 1, 2, 3, 0, 1, 2, 3])
rows = _pattern([0, 0, 0, 0, 1, 1, 1, 1])


def _pointers(context, builder, signature, args):
    """Where the two rows of a block begin in a flat array; nothing is checked."""
    data = context.make_array(signature.args[0])(context, builder, args[0]).data
    k, stride = (
        context.cast(builder, value, of, types.intp)
        for value, of in zip(args[1:3], signature.args[1:3], strict=True)
    )
    half = ir.VectorType(_F32, COLUMNS).as_pointer()
    starts = (k, builder.add(k, stride))
    return [builder.bitcast(builder.gep(data, [start]), half) for start in starts]


def _choose(first, count):
    return ir.Constant(ir.VectorType(_I32, count), list(range(first, first + count)))


@intrinsic
def load(typingctx, array, index, stride):
    """The block at ``index`` of a flat float32 array whose rows are ``stride`` apart."""

    def codegen(context, builder, signature, args):
        above, below = (
            builder.load(at, align=4) for at in _pointers(context, builder, signature, args)
        )
        return builder.shuffle_vector(above, below, _choose(0, LANES))

    return lanes(array, index, stride), codegen


@intrinsic
def store(typingctx, array, index, stride, value):
    """Write the block at ``index`` of a flat float32 array whose rows are ``stride`` apart."""

    def codegen(context, builder, signature, args):
        for row, at in enumerate(_pointers(context, builder, signature, args)):
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
def total(typingctx, a):
    """The sum of the eight lanes, always in the same order."""

    def codegen(context, builder, signature, args):
        parts = [builder.extract_element(args[0], ir.Constant(_I32, i)) for i in range(LANES)]
        while len(parts) > 1:
            half = len(parts) // 2
            pairs = zip(parts[:half], parts[half:], strict=True)
            parts = [builder.fadd(a, b) for a, b in pairs]
        return parts[0]

    return types.float32(lanes), codegen


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
