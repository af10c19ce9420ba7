"""Equations in plain text as MathML, which browsers draw without a script or a font.

The plain text is that of the paper's equations: products by a space, ``/`` for a fraction, ``^``
and ``_`` for what is above and below, ``{}`` for a group of these, ``sqrt``, ``sum`` and ``int``,
and the names of Greek letters.  A fraction with spaces around its ``/`` has the whole product
before it as its numerator, one without them the last factor alone.
"""

from __future__ import annotations

import re
from html import escape
from typing import Final

_TOKEN: Final = re.compile(
    r"(?P<spaced> / )|(?P<space>\s+)|(?P<number>\d+(?:\.\d+)?)|(?P<name>[A-Za-z]+)|(?P<sign>.)"
)
_GREEK: Final = {
    name: chr(code)
    for name, code in {
        "alpha": 0x3B1, "beta": 0x3B2, "lambda": 0x3BB, "phi": 0x3C6, "pi": 0x3C0, "rho": 0x3C1,
        "theta": 0x3B8,
    }.items()
}  # fmt: skip
_LARGE: Final = {"sum": "∑", "int": "∫"}
_SIGNS: Final = {"-": "−"}
_CLOSING: Final = {"(": ")", "{": "}", "|": "|"}
_BETWEEN_TERMS: Final = "=+-,"


def equation_mathml(text: str) -> str:
    """Return an equation in plain text as an element of MathML; words without a ``=`` as they are.

    Examples
    --------
    >>> equation_mathml("E = P^2 / rho")
    '<math><mi>E</mi><mo>=</mo><mfrac><msup><mi>P</mi><mn>2</mn></msup><mi>ρ</mi></mfrac></math>'
    """
    return f"<math>{_MathmlReader(text).terms(until='')}</math>" if "=" in text else escape(text)


class _MathmlReader:
    """Reads the tokens of one equation."""

    def __init__(self, text: str) -> None:
        found = _TOKEN.finditer(text)
        self._tokens = [(str(match.lastgroup), match[0]) for match in found]
        self._at = 0

    def terms(self, until: str) -> str:
        """Return everything up to the sign *until*, which is taken as well."""
        done: list[str] = []
        product: list[str] = []
        while self._at < len(self._tokens):
            kind, token = self._tokens[self._at]
            if token == until:
                self._at += 1
                break
            if kind == "spaced":
                self._at += 1
                product = [f"<mfrac>{_mathml_row(product)}{self._factor(bare=True)}</mfrac>"]
            elif token == "/":
                self._at += 1
                product.append(f"<mfrac>{product.pop()}{self._factor(bare=True)}</mfrac>")
            elif token in _BETWEEN_TERMS:
                self._at += 1
                done += [*product, f"<mo>{_SIGNS.get(token, token)}</mo>"]
                product = []
            elif kind == "space":
                self._at += 1
            else:
                product.append(self._factor())
        return "".join([*done, *product])

    def _factor(self, *, bare: bool = False) -> str:
        """Return the next factor with what is above and below it; *bare*: without parentheses."""
        base = self._base(bare=bare)
        below = self._script("_")
        above = self._script("^")
        if below and above:
            return f"<msubsup>{base}{below}{above}</msubsup>"
        if below:
            return f"<msub>{base}{below}</msub>"
        return f"<msup>{base}{above}</msup>" if above else base

    def _base(self, *, bare: bool) -> str:
        kind, token = self._tokens[self._at]
        self._at += 1
        if kind == "number":
            return f"<mn>{token}</mn>"
        if token == "sqrt":
            return f"<msqrt>{self._factor(bare=True)}</msqrt>"
        if token in _LARGE:
            return f"<mo>{_LARGE[token]}</mo>"
        if kind == "name":
            return self._name(token)
        if token in _CLOSING:
            inner = self.terms(until=_CLOSING[token])
            if bare or token == "{":
                return f"<mrow>{inner}</mrow>"
            return f"<mrow><mo>{token}</mo>{inner}<mo>{_CLOSING[token]}</mo></mrow>"
        return f"<mo>{escape(token)}</mo>"

    def _name(self, token: str) -> str:
        """Return a symbol; digits after it are its index, and several letters are a product."""
        number = self._next("number")
        index = "" if number is None else f"<mn>{number}</mn>"
        if token in _GREEK:
            base = f"<mi>{_GREEK[token]}</mi>"
        elif len(token) == 2 and token[0] == "d" and index:  # dx0
            return f"<mi>d</mi><msub><mi>{token[1]}</mi>{index}</msub>"
        elif len(token) == 2 and token[1] in "mn":  # xm
            return f"<msub><mi>{token[0]}</mi><mi>{token[1]}</mi></msub>"
        else:
            base = "".join(f"<mi>{letter}</mi>" for letter in token)
        return f"<msub>{base}{index}</msub>" if index else base

    def _script(self, sign: str) -> str:
        """Return what stands above or below the last base, or an empty text."""
        if self._next("sign", sign) is None:
            return ""
        name = self._next("name")
        if name is None:
            return self._base(bare=True)
        return f"<mi>{_GREEK.get(name, name)}</mi>"

    def _next(self, kind: str, token: str | None = None) -> str | None:
        """Take the next token if it is of this kind, and *token* if that is given."""
        if self._at < len(self._tokens):
            found, text = self._tokens[self._at]
            if found == kind and token in (None, text):
                self._at += 1
                return text
        return None


def _mathml_row(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"<mrow>{''.join(parts)}</mrow>"
