"""Angles x from 2**31 on: n and r of x = n pi / 2 + r, by integer arithmetic.

x is m 2**e with an integer m below 2**53. Of the bits of 2 / pi, 192 count: products of x with
those before are multiples of 4, and those after move x 2 / pi by less than 2**-137. No double is
nearer to a multiple of pi / 2 than 2**-62.
"""

import math

import numpy as np

LIMIT = 2.0**31
# The first 1216 bits of 2 / pi, and the first 128 of pi / 4
_PER_QUARTER = int(
    "A2F9836E4E441529FC2757D1F534DDC0DB6295993C439041FE5163ABDEBBC561B7246E3A424D"
    "D2E006492EEA09D1921CFE1DEB1CB129A73EE88235F52EBB4484E99C7026B45F7E413991D639"
    "835339F49C845F8BBDF9283B1FF897FFDE05980FEF2F118B5A0A6D1F6D367ECF27CB09B74F46"
    "3F669E5FEA2D7527BAC7EBE5F17B3D0739F78A5292EA6BFB5FB11F8D5D0856033046FC7B6BAB",
    16,
)
_EIGHTH = 0xC90FDAA22168C234C4C6628B80DC1CD1


def remainder(x):
    """Return n from 0 to 3, and r in two parts, of a finite x >= LIMIT."""
    fraction, exponent = math.frexp(x)
    m, e = int(fraction * 2.0**53), exponent - 53
    window = _PER_QUARTER >> 1026 - e & 2**192 - 1
    quarters = m * window & 2**192 - 1  # in units of 2**-190
    n = quarters + 2**189 >> 190
    rest = quarters - (n << 190)
    bits, sign = abs(rest), math.copysign(1.0, rest)
    zeros = 192 - bits.bit_length()
    r = ((bits << zeros) >> 64) * _EIGHTH >> 128
    high, low = float(r >> 75), float(r >> 11 & 2**64 - 1)
    return float(n & 3), sign * math.ldexp(high, -50 - zeros), sign * math.ldexp(low, -114 - zeros)


def _in_numpy(part):
    def of_arrays(x, usual):
        x, result = np.broadcast_arrays(x, usual)
        result = result.copy()
        is_far = (x >= LIMIT) & (x < np.inf)
        result[is_far] = [remainder(number)[part] for number in x[is_far].tolist()]
        return result

    return of_arrays


# Instructions (x, usual) for n and the parts of r, which are `usual` unless LIMIT <= x < inf.
PARTS = {name: _in_numpy(k) for k, name in enumerate(("far_quarters", "far_high", "far_low"))}


def text_of_far(pointer):
    """Return the text of a function for LLVM: the value of `remainder` with this number.

    pointer(kind) is the type of an address.
    """
    # The table has zeros after the bits of 2 / pi, for the last windows.
    return f"""\
@far_table = internal constant i1344 {_PER_QUARTER}
define internal double @far(double %x, i64 %number) #0 {{
  %bits = bitcast double %x to i64
  %exponent = lshr i64 %bits, 52
  %fraction = and i64 %bits, {2**52 - 1}
  %m = or i64 %fraction, {2**52}
  %shift = sub i64 {1026 + 1075}, %exponent
  %byte = lshr i64 %shift, 3
  %start = ptrtoint {pointer("i1344")} @far_table to i64
  %place = add i64 %start, %byte
  %address = inttoptr i64 %place to {pointer("i256")}
  %loaded = load i256, {pointer("i256")} %address, align 1
  %bit = and i64 %shift, 7
  %by = zext i64 %bit to i256
  %shifted = lshr i256 %loaded, %by
  %window = trunc i256 %shifted to i192
  %wide_m = zext i64 %m to i192
  %quarters = mul i192 %wide_m, %window
  %raised = add i192 %quarters, {2**189}
  %n = lshr i192 %raised, 190
  %whole = shl i192 %n, 190
  %rest = sub i192 %quarters, %whole
  %below = icmp slt i192 %rest, 0
  %minus = sub i192 0, %rest
  %size = select i1 %below, i192 %minus, i192 %rest
  %zeros = call i192 @llvm.ctlz.i192(i192 %size, i1 true)
  %normal = shl i192 %size, %zeros
  %first = lshr i192 %normal, 64
  %wide = zext i192 %first to i256
  %product = mul i256 %wide, {_EIGHTH}
  %r = lshr i256 %product, 128
  %r_high = lshr i256 %r, 75
  %r_low = lshr i256 %r, 11
  %i_high = trunc i256 %r_high to i64
  %i_low = trunc i256 %r_low to i64
  %d_high = uitofp i64 %i_high to double
  %d_low = uitofp i64 %i_low to double
  %zeros64 = trunc i192 %zeros to i64
  %b_high = sub i64 {1023 - 50}, %zeros64
  %b_low = sub i64 {1023 - 114}, %zeros64
  %s_high = shl i64 %b_high, 52
  %s_low = shl i64 %b_low, 52
  %sign = select i1 %below, i64 {-(2**63)}, i64 0
  %t_high = or i64 %s_high, %sign
  %t_low = or i64 %s_low, %sign
  %f_high = bitcast i64 %t_high to double
  %f_low = bitcast i64 %t_low to double
  %high = fmul double %d_high, %f_high
  %low = fmul double %d_low, %f_low
  %n64 = trunc i192 %n to i64
  %quarter = uitofp i64 %n64 to double
  %is_n = icmp eq i64 %number, 0
  %is_high = icmp eq i64 %number, 1
  %part = select i1 %is_high, double %high, double %low
  %value = select i1 %is_n, double %quarter, double %part
  ret double %value
}}
"""
