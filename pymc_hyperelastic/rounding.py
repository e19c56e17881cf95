"""How far two numbers may differ and count as equal, so that rounding errors decide nothing.

Converting units, writing a file or another order of a sum changes the last of the 16 digits of a
number; no measurement of soft tissue has nine.
"""

#: Decimals to which numbers are rounded before they are compared or sorted.
DIGITS = 9
#: Relative difference of two equal numbers.
ROUNDING = 1e-9
