"""How numbers are rounded: before they are compared, and where people read them.

Converting units, writing a file or another order of a sum changes the last of the 16 digits of a
number; no measurement of soft tissue has nine. An error is known to two digits at most.
"""

import math
from collections.abc import Sequence

#: Decimals to which numbers are rounded before they are compared or sorted.
DIGITS = 9
#: Relative difference of two equal numbers.
ROUNDING = 1e-9


def short(value: float) -> str:
    """Return four significant digits of a number without an error.

    >>> short(-1234.5678), short(0.00001234), short(float("inf")), short(float("nan"))
    ('−1235', '1.234e−05', 'infinite', 'unknown')
    """
    text = "unknown" if math.isnan(value) else f"{value:.4g}"
    return text.replace("inf", "infinite").replace("-", "−")


def rounded(numbers: Sequence[float], error: float) -> list[str]:
    """Return numbers to the decimal of the second significant digit of an error.

    A third digit is below a tenth of what any error is known to. A number that would be printed as
    0 keeps one digit. If the error is not a positive number, all numbers have four digits. Numbers
    of a million and more, and those with more than six decimals, are written as powers of ten.

    >>> rounded([-17.1834, 0.0403], 0.0403), rounded([12345.0, 1234.0], 1234.0)
    (['−17.183', '0.040'], ['12300', '1200'])
    >>> rounded([0.13, 0.0011, 0.83], 0.129)
    ['0.13', '0.001', '0.83']
    """
    if not (math.isfinite(error) and error > 0):
        return [short(number) for number in numbers]
    decimals = 1 - _exponent(error, 1)
    known = [abs(number) for number in numbers if math.isfinite(number)]
    powers = decimals > 6 or max(known, default=0.0) >= 1e6
    return [_rounded(number, decimals, powers) for number in numbers]


def rounded_interval(value: float, low: float, high: float) -> list[str]:
    """Return a value and the ends of its interval, rounded by the distance of the nearer end.

    An end that is more than ten times as far is rounded by its own distance.

    >>> rounded_interval(0.35087, 0.23522, 0.555), rounded_interval(620.2, 406.8, 13820.0)
    (['0.35', '0.24', '0.56'], ['620', '410', '14000'])
    """
    nearer = min(value - low, high - value)
    texts = rounded([value, low, high], nearer)
    for place, end in ((1, low), (2, high)):
        if math.isfinite(end) and abs(end - value) > 10 * nearer:
            (texts[place],) = rounded([end], abs(end - value))
    return texts


def _exponent(number: float, decimals: int) -> int:
    """Return the power of ten of a positive number, after it is rounded."""
    return int(f"{number:.{decimals}e}".split("e")[1])


def _rounded(number: float, decimals: int, powers: bool) -> str:
    if not math.isfinite(number):
        return short(number)
    if powers and number:
        text = f"{number:.{max(0, _exponent(abs(number), 0) + decimals)}e}"
    else:
        text = f"{round(number, decimals):.{max(0, decimals)}f}"
    if number and not float(text):
        text = f"{number:.1g}"
    return text.replace("-", "−")
